"""Reading of whole files, with one clear line for what cannot be read."""

import errno
import os
import stat
from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.contained import find_contained


def read_bytes(path: Path) -> bytes:
    """The content of a file, or of one in a bag. Raises InputError if missing, or a pipe."""
    if inner := find_contained(path):
        return inner.read()
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a file")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def damaged_map(path: Path, why: object) -> InputError:
    """The error for a part of a map that is not as this program writes it."""
    return InputError(f"{path}: is damaged ({why}): make the map again with stereo-seecolor fuse")


def regular_bytes(path: Path) -> bytes:
    """The content of a file in OUT. Raises OSError, also for a named pipe."""
    if kind := special_kind(path):
        raise OSError(errno.EINVAL, f"is {kind}, not a file", str(path))
    return path.read_bytes()


def special_kind(path: Path) -> str:
    """Name what ``path`` is where it is not a regular file, "" where it is one: opening a named
    pipe or a device could wait forever.

    Raises OSError if the path does not exist.
    """
    mode = path.stat().st_mode
    if stat.S_ISREG(mode):
        return ""
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(mode), "a device")


def entry_problem(entry: os.DirEntry[str]) -> str:
    """Why a folder's entry cannot be read as a file; "" where it can."""
    if entry.is_file():
        return ""
    try:
        return f"is {special_kind(Path(entry.path))}, not a file"
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
