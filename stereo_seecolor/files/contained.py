"""Files that lie inside others: ``dive.mcap/left/1700000000-100000000.png`` is read from the bag, and never written to disk."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol


class Container(Protocol):
    """A file that holds others."""

    def read(self, name: str) -> bytes:
        """The content of the file of that name in it (``left/0001.png``). Raises InputError."""


@dataclass(frozen=True)
class ContainedFile:
    """One file in a container. outer: the file on disk that holds it."""

    outer: Path
    name: str
    container: Container

    def read(self) -> bytes:
        """Its content. Raises InputError."""
        return self.container.read(self.name)


_containers: dict[Path, Container] = {}


def open_containers(containers: Mapping[Path, Container]) -> None:
    """From now on, for as long as the program runs, paths that lead into these files can be read."""
    _containers.update(containers)


def contained(path: Path) -> ContainedFile | None:
    """What ``path`` means inside a container that was opened; None for a path of the disk."""
    if not _containers:
        return None
    outer = next((parent for parent in path.parents if parent in _containers), None)
    return ContainedFile(outer, path.relative_to(outer).as_posix(), _containers[outer]) if outer else None


def is_there(path: Path) -> bool:
    """True for a file of the disk, and for a path that leads into one."""
    return path.is_file() or any(parent.is_file() for parent in path.parents)
