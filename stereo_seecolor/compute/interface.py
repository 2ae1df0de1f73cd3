"""The one interface through which a command's work over pairs and tiles is run, wherever that is."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Usage:
    """What the processes that work for this one have used until now.

    cores: that work at once, also where this process works itself. core_seconds: processor time, and memory_bytes: the most that
    one of them had at once; both 0 where this process works itself.
    """

    cores: int
    core_seconds: float = 0.0
    memory_bytes: int = 0


class Compute(Protocol):
    """Where work runs. The results are the same wherever that is, whatever the number of workers.

    An exception of ``work`` ends the iteration and is raised in the caller; what is under way is finished, and nothing more begun.
    """

    @property
    def usage(self) -> Usage:
        """What the work has cost so far."""

    @property
    def parts(self) -> int:
        """Into how many parts work is to be cut that could use all cores of this machine: 1 here, one a core of a cluster."""

    def sharing(self, folder: Path, inputs: Sequence[Path]) -> AbstractContextManager[None]:
        """While work writes into ``folder`` and reads ``inputs``: where it runs, both are seen, or ClusterError is raised."""

    def each(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every item, such as a pair, in the items' order; a bounded number is under way, items are taken as needed."""

    def tiles(self, work: Callable[[Item], Result], tiles: Iterable[Item]) -> Iterator[Result]:
        """As ``each``, for work that fills the memory and uses all cores of a machine, such as a tile of the map."""
