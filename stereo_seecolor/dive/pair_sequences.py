"""Sequences over a dive's pairs: some, with names, or in groups; items are made when asked for."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stereo_seecolor.compute.sequences import Chosen, Lazy
from stereo_seecolor.inputs.pairing import Pair

GROUP = 32
"""Pairs of a group. A segment with a water of its own begins with one, and has 256 frames or more
in a dive that needs groups.
"""


def chosen(pairs: Sequence[Pair], wanted: Callable[[Pair], bool]) -> Sequence[Pair]:
    """The pairs that are ``wanted``, in their order."""
    return Chosen(pairs, array("q", (number for number, pair in enumerate(pairs) if wanted(pair))))


@dataclass(frozen=True)
class NamedPairs(Lazy[tuple[str, Pair]]):
    """Pairs with their names."""

    pairs: Sequence[Pair]

    def __len__(self) -> int:
        return len(self.pairs)

    def item(self, number: int) -> tuple[str, Pair]:
        """The pair of this number, and its name."""
        pair = self.pairs[number]
        return pair.name, pair


@dataclass(frozen=True)
class Groups(Lazy[Sequence[Pair]]):
    """Groups of neighboring pairs, the same for any workers: sums add in the same order."""

    pairs: Sequence[Pair]

    def __len__(self) -> int:
        return -(-len(self.pairs) // GROUP)

    def item(self, number: int) -> Sequence[Pair]:
        """The group of this number."""
        return self.pairs[number * GROUP : (number + 1) * GROUP]
