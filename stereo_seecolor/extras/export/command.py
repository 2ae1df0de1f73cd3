"""``export``: write a fused run in the format of another program, into a new folder."""

import re
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereo_seecolor.errors import InputError, PluginError
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.files.free_places import new_folder
from stereo_seecolor.plugins import added, load
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.layout import MAP, MOSAIC, TERRAIN
from stereo_seecolor.run_folder.own_paths import refuse_own_place
from stereo_seecolor.run_folder.posed_run import open_posed_run

GEOTIFFS = f"{MAP}/{MOSAIC} and {MAP}/{TERRAIN} of OUT are GeoTIFFs; open them directly"
"""What programs for maps need no export for."""
FOR_MAPS = ("qgis", "arcgis", "arcmap", "geotiff")


@dataclass(frozen=True)
class ExportResult:
    """The exported files: their number and size. frames: number of the map's frames. note: quality,
    for formats that measure it.
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
        note or "",
    )


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


# The export formats of all installed packages, by name.


def export_formats() -> dict[str, ExportFormat]:
    """What each format writes, and the function that writes it. Raises PluginError for a package
    that cannot be loaded.
    """
    return {name: load("exports", name, ExportFormat) for name in added("exports")}


# Corrected images as 8 bits a channel, which any program reads.

READABLE = (".png", ".jpg")


def write_images(frames: Sequence[FinishedFrame], folder: Path) -> list[Path]:
    """Make ``folder/images``, and put the corrected image of each frame into it; the files, of 8
    bits as they are, else as PNG.

    Raises InputError if an image is gone or damaged.
    """
    (folder / "images").mkdir()
    return [_write_image(frame, folder / "images") for frame in frames]


def _write_image(frame: FinishedFrame, folder: Path) -> Path:
    pixels = frame.read("corrected")
    source = frame.products["corrected"]
    if pixels.dtype == np.uint8 and source.suffix in READABLE:
        return Path(shutil.copyfile(source, folder / source.name))
    path = folder / f"{frame.name}.png"
    path.write_bytes(encode_image(eight_bit(pixels), "png"))
    return path
