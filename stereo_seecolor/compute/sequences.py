"""Sequences whose items are made when asked for, since a dive's do not fit into memory."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, overload

Item = TypeVar("Item", covariant=True)


class Lazy(Sequence[Item]):
    """A sequence whose items ``item`` makes; a slice of it is a list."""

    @abstractmethod
    def item(self, number: int) -> Item:
        """The item of this number, from 0 to the length less 1."""

    @overload
    def __getitem__(self, index: int) -> Item: ...
    @overload
    def __getitem__(self, index: slice) -> list[Item]: ...
    def __getitem__(self, index: int | slice) -> Item | list[Item]:
        if isinstance(index, slice):
            return [self.item(i) for i in range(len(self))[index]]
        return self.item(range(len(self))[index])


class Changed(Lazy[Item]):
    """What ``change`` makes of each item of a sequence."""

    def __init__(self, items: Sequence[Any], change: Callable[[Any], Item]) -> None:
        self._items, self._change = items, change

    def __len__(self) -> int:
        return len(self._items)

    def item(self, number: int) -> Item:
        """Make the item of this number."""
        return self._change(self._items[number])
