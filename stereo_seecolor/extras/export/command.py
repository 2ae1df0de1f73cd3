"""``export``: write a fused run in the format of another program, into a new folder."""

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.errors import InputError, PluginError
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.free_places import new_folder
from stereo_seecolor.plugins import added, load
from stereo_seecolor.run_folder.layout import MAP, MOSAIC, TERRAIN
from stereo_seecolor.run_folder.own_paths import refuse_own_place
from stereo_seecolor.run_folder.posed_run import open_posed_run

GEOTIFFS = f"{MAP}/{MOSAIC} and {MAP}/{TERRAIN} of OUT are GeoTIFFs; open them directly"
"""What programs for maps need no export for."""
FOR_MAPS = ("qgis", "arcgis", "arcmap", "geotiff")


@dataclass(frozen=True)
class ExportResult:
    """The exported files: their number and size. frames: number of the map's frames. note: quality,
    for formats that measure it, and frames that are left out.
    """

    format: str
    folder: Path
    frames: int
    files: int
    bytes: int
    note: str = ""


def export(out: Path, format: str, folder: Path) -> ExportResult:
    """Write the run in ``out`` in a format of ``export --list`` into ``folder``, new or empty:
    complete or not at all.

    Raises InputError for an unknown format, or a run without a map; OutputError if the folder holds
    anything, or cannot be written; DeviceError if a library is missing.
    """
    if format not in added("exports"):
        raise InputError(f"--to {format}: is not a known format: {_instead(format)}")
    known: ExportFormat = load("exports", format, ExportFormat)
    refuse_own_place(folder)
    posed = open_posed_run(out)
    with new_folder(folder) as building:
        note = known.write(posed, building)
    written = list(files_below(folder))
    return ExportResult(
        format,
        folder,
        len(posed.frames),
        len(written),
        sum(path.stat().st_size for path in written),
        "; ".join(text for text in (note, posed.left_out) if text),
    )


def export_formats() -> dict[str, ExportFormat]:
    """The export formats of all installed packages, by name. Raises PluginError."""
    return {name: load("exports", name, ExportFormat) for name in added("exports")}


def _instead(name: str) -> str:
    """What to take for a program of that name; all formats, where it is none."""
    program, found = name.lower(), []
    for key in added("exports"):
        with suppress(PluginError):
            if program in re.findall(r"\w+", load("exports", key, ExportFormat).opens.lower()):
                found.append(f"--to {key}")
    said = [GEOTIFFS] if program in FOR_MAPS else []
    said += [f"for {name} use {' or '.join(found)}"] if found else []
    return "; ".join(said) or f"one of {', '.join(added('exports'))}"
