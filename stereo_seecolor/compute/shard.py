"""A part of the pairs of a dive, for machines that divide the work without a connection."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from stereo_seecolor.compute.interface import Item


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
