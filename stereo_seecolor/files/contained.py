"""Files that lie inside others: ``dive.mcap/left/1700000000-100000000.png`` is read from the bag,
and never written to disk.
"""

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


def find_contained(path: Path) -> ContainedFile | None:
    """Find the contained file that ``path`` names; None for a path of the disk."""
    if not _containers:
        return None
    for outer in path.parents:
        if outer in _containers:
            return ContainedFile(outer, path.relative_to(outer).as_posix(), _containers[outer])
    return None


def is_there(path: Path) -> bool:
    """Tell whether ``path`` is a file on disk, or one in an opened container."""
    return path.is_file() or any(parent.is_file() for parent in path.parents)
