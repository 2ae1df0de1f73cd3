"""The interface through which commands run work on pairs and tiles, on this machine or on a
cluster.
"""

import re
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
    """Runs work on many items. The results do not depend on where it runs, or on the number of
    workers.

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
        """``each`` for work that fills the memory and uses all cores of a machine, such as a tile
        of the map.
        """


# A part of a dive's pairs, for machines that divide the work without a connection.


@dataclass(frozen=True)
class Shard:
    """Part ``number`` (from 1) of ``of`` parts. A part holds neighbors in the dive's order; sizes
    differ by one item at most.
    """

    number: int = 1
    of: int = 1

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Parse ``2/8``, as on the command line. Raises ValueError."""
        found = re.fullmatch(r"(\d+)/(\d+)", text)
        shard = cls(int(found[1]), int(found[2])) if found else cls(0)
        if not 1 <= shard.number <= shard.of:
            raise ValueError(
                f"{text!r} is not a shard: write i/N with i from 1 to N, for example 2/8"
            )
        return shard

    @property
    def whole(self) -> bool:
        """True if this is the only shard."""
        return self.of == 1

    def part(self, items: Sequence[Item]) -> Sequence[Item]:
        """The items of this shard. items: all items, in the same order for every shard."""
        return items[
            len(items) * (self.number - 1) // self.of : len(items) * self.number // self.of
        ]

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


WHOLE = Shard()
"""All items."""
