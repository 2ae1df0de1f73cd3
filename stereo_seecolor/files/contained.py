"""Files that lie inside others: ``dive.mcap/left/1700000000-100000000.png`` is read from the bag,
and never written to disk.
"""

import errno
import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from stereo_seecolor.errors import InputError


class Container(Protocol):
    """A file that holds others."""

    def read(self, name: str) -> bytes:
        """The content of the file of that name in it (``left/0001.png``). Raises InputError."""


@dataclass(frozen=True)
class ContainedFile:
    """A file in a container. outer: the file on disk that holds it."""

    outer: Path
    name: str
    container: Container

    def read(self) -> bytes:
        """Read its content. Raises InputError."""
        return self.container.read(self.name)


_containers: dict[Path, Container] = {}


def open_containers(containers: Mapping[Path, Container]) -> None:
    """Make paths that lead into these files readable, for as long as the program runs."""
    _containers.update(containers)


def contained(path: Path) -> ContainedFile | None:
    """Find the contained file that ``path`` names; None for a path of the disk."""
    if not _containers:
        return None
    outer = next((parent for parent in path.parents if parent in _containers), None)
    return (
        ContainedFile(outer, path.relative_to(outer).as_posix(), _containers[outer])
        if outer
        else None
    )


def is_there(path: Path) -> bool:
    """Tell whether ``path`` is a file on disk, or one in an opened container."""
    return path.is_file() or any(parent.is_file() for parent in path.parents)


# Reading of whole files, with one clear line for what cannot be read.


def read_bytes(path: Path) -> bytes:
    """The content of a regular file, or of one in a bag. Raises InputError if it is missing, or a
    named pipe, say.
    """
    if inner := contained(path):
        return inner.read()
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a file")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def regular_bytes(path: Path) -> bytes:
    """The content of a file in OUT. Raises OSError, also for a named pipe, which would be waited
    for.
    """
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
