"""``export``: write a fused run in the format of another program, into a new folder."""

from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.new_folder import new_folder
from stereo_seecolor.plugins import added, load
from stereo_seecolor.run_folder.posed_run import open_posed_run


@dataclass(frozen=True)
class ExportResult:
    """The exported files: their number and size. frames: number of the map's frames. note: quality, for formats that measure it."""

    format: str
    folder: Path
    frames: int
    files: int
    bytes: int
    note: str = ""


def export(out: Path, format: str, folder: Path) -> ExportResult:
    """Write the run in ``out`` in a format of ``export --list`` into ``folder``, new or empty: complete or not at all.

    Raises InputError for an unknown format, or a run without a map; OutputError if the folder holds anything, or cannot be
    written; DeviceError if a library is missing.
    """
    if format not in added("exports"):
        raise InputError(f"--to {format}: is not a known format: one of {', '.join(added('exports'))}")
    known: ExportFormat = load("exports", format)
    posed = open_posed_run(out)
    with new_folder(folder) as building:
        note = known.write(posed, building)
    written = list(files_below(folder))
    return ExportResult(format, folder, len(posed.frames), len(written), sum(path.stat().st_size for path in written), note or "")
