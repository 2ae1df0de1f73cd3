"""``export``: a fused run in the form that another program opens, in a folder of its own."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.export.formats import EXPORT_FORMATS
from stereo_seecolor.export.posed_run import open_posed_run
from stereo_seecolor.files.atomic import files_below, flush_folder, output_errors, temporary_path


@dataclass(frozen=True)
class ExportResult:
    """What was written. folder: where. files, bytes: how much. frames: of the map that it holds."""

    format: str
    folder: Path
    frames: int
    files: int
    bytes: int


def export(out: Path, format: str, folder: Path) -> ExportResult:
    """Write the run in ``out`` in a format of EXPORT_FORMATS into ``folder``, which must be new or empty; all of it or nothing.

    Raises InputError for an unknown format, or a run without a map; OutputError if the folder holds anything, or cannot be
    written; DeviceError if a library is missing.
    """
    if format not in EXPORT_FORMATS:
        raise InputError(f"--to {format}: is no format known here: one of {', '.join(EXPORT_FORMATS)}")
    posed = open_posed_run(out)
    _refuse_filled(folder)
    building = temporary_path(folder)
    try:
        with output_errors(folder):
            building.mkdir(parents=True)
            EXPORT_FORMATS[format].write(posed, building)
            if folder.is_dir():
                folder.rmdir()  # empty, as was looked at
            building.rename(folder)
            flush_folder(folder.parent)
    finally:
        shutil.rmtree(building, ignore_errors=True)
    written = list(files_below(folder))
    return ExportResult(format, folder, len(posed.frames), len(written), sum(path.stat().st_size for path in written))


def _refuse_filled(folder: Path) -> None:
    if folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir()))):
        raise OutputError(f"{folder}: is there already: an export goes into a new or an empty folder; nothing was touched")
