"""Items of a sequence that are changed when they are asked for."""

from collections.abc import Callable, Sequence
from typing import Any

from stereo_seecolor.compute.sequences import Item, Lazy


class Changed(Lazy[Item]):
    """What ``change`` makes of each item of a sequence."""

    def __init__(self, items: Sequence[Any], change: Callable[[Any], Item]) -> None:
        self._items, self._change = items, change

    def __len__(self) -> int:
        return len(self._items)

    def item(self, number: int) -> Item:
        """Make the item of this number."""
        return self._change(self._items[number])
