"""Output to a place that must be free: a file, or a folder that is written whole or not at all."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from calibration.files import flush_folder
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import output_errors, remove, temporaries_of, temporary_path

fcntl: Any = None if os.name == "nt" else import_module("fcntl")


def refuse_existing(*files: Path, option: str = "") -> None:
    """Raise OutputError if one of ``files`` exists: it may be the user's only calibration. option:
    that names another file, of a file that has a default name.
    """
    by = f" by {option}" if option else ""
    for file in files:
        if file.exists() or file.is_symlink():
            raise OutputError(
                f"{file}: already exists, and is not overwritten: give another name{by}; nothing "
                "was changed"
            )


def refuse_filled(folder: Path) -> None:
    """Raise OutputError if ``folder`` holds anything, is not a folder, or the current one."""
    if folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir()))):
        raise OutputError(
            f"{folder}: already exists: give a new or an empty folder; nothing was changed"
        )
    if folder.is_dir() and folder.samefile(os.curdir):
        raise OutputError(
            f"{folder}: is the current folder, and would be replaced: give the name of a new "
            "folder; nothing was changed"
        )


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder to write into, which becomes ``folder`` when the block ends well, else is removed.

    Raises OutputError if ``folder`` holds anything, or cannot be written.
    """
    refuse_filled(folder)
    _remove_abandoned(folder)
    building = temporary_path(folder)
    try:
        with output_errors(folder):
            building.mkdir(parents=True)
            with _locked(building):
                yield building
            if folder.is_dir():
                folder.rmdir()  # empty, as was checked
            building.rename(folder)
            flush_folder(folder.parent)
    finally:
        shutil.rmtree(building, ignore_errors=True)


@contextmanager
def _locked(building: Path) -> Iterator[bool]:
    """Lock a folder while it is written, where the system can; a killed process leaves no lock.
    False where another holds it.
    """
    if fcntl is None:
        yield False
        return
    handle, held = os.open(building, os.O_RDONLY), False
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held = True
        yield held
    finally:
        os.close(handle)


def _remove_abandoned(folder: Path) -> None:
    """Delete what killed processes had begun to write for this ``folder``, beside it."""
    for begun in temporaries_of(folder):
        with contextlib.suppress(OSError), _locked(begun) as abandoned:
            if abandoned:
                remove(begun)
