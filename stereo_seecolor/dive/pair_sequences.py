"""Sequences over a dive's pairs: some, with names, or in groups; items are made when asked for."""

from array import array
from collections.abc import Callable, Sequence

from stereo_seecolor.compute.sequences import Changed
from stereo_seecolor.inputs.pairing import Pair

GROUP = 32
"""Pairs of a group. A segment with a water of its own begins with one, and has 256 frames or more
in a dive that needs groups.
"""


def chosen(pairs: Sequence[Pair], wanted: Callable[[Pair], bool]) -> Sequence[Pair]:
    """The pairs that are ``wanted``, in their order."""
    numbers = array("q", (number for number, pair in enumerate(pairs) if wanted(pair)))
    return Changed(numbers, pairs.__getitem__)


def with_names(pairs: Sequence[Pair]) -> Sequence[tuple[str, Pair]]:
    """The pairs with their names."""
    return Changed(pairs, lambda pair: (pair.name, pair))


def groups(pairs: Sequence[Pair]) -> Sequence[Sequence[Pair]]:
    """Groups of neighboring pairs, the same for any workers: sums add in the same order."""
    return Changed(range(0, len(pairs), GROUP), lambda first: pairs[first : first + GROUP])
