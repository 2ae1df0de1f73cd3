"""The interface by which commands run work on pairs and tiles, here or on a cluster."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Usage:
    """The resources that worker processes have used so far.

    cores: number of cores in use, also where this process works itself. core_seconds: processor
    time of other processes, and memory_bytes: the largest memory of one of them; both 0 where this
    process works itself.
    """

    cores: int
    core_seconds: float = 0.0
    memory_bytes: int = 0


class Compute(Protocol):
    """Runs work on many items. Results do not depend on where, or the number of workers.

    An exception of ``work`` ends the iteration and is raised in the caller; work under way is
    finished, and no more is begun.
    """

    @property
    def usage(self) -> Usage:
        """The resources used so far."""

    @property
    def parts(self) -> int:
        """Number of parts into which to cut work that uses all cores of a machine: 1 here, one for
        each core of a cluster.
        """

    def sharing(self, folder: Path, inputs: Sequence[Path]) -> AbstractContextManager[None]:
        """Make sure, while the block runs, that workers see the ``folder`` that they write into and
        their ``inputs``.

        Where one does not, its work raises ClusterError.
        """

    def each(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every item, in order. A bounded number of items is under way; items are taken
        when they are needed.
        """

    def tiles(self, work: Callable[[Item], Result], tiles: Iterable[Item]) -> Iterator[Result]:
        """``each`` for work that fills the memory and uses all cores, such as a map's tile."""
