"""Names of a dive's frames in little memory, found by number, and numbers by name."""

from array import array
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.sequences import Lazy

Item = TypeVar("Item")

SLOTS = 1 << 6
"""Places of the hash table at first; twice as many whenever half of them are taken."""
FREE = -1


class Names(Lazy[str]):
    """Different names in the order of their adding: 40 bytes each, while a dict takes 200."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._text, self._ends = bytearray(), array("q", [0])
        self._slots = array("i", [FREE]) * SLOTS
        for name in names:
            self.add(name)

    def __reduce__(self) -> "tuple[Callable[[bytes, bytes], Names], tuple[bytes, bytes]]":
        return _unpickled, (bytes(self._text), self._ends.tobytes())

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __iter__(self) -> Iterator[str]:
        return map(self.item, range(len(self)))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self.number(name) is not None

    def item(self, number: int) -> str:
        """The name of this number."""
        return self._text[self._ends[number] : self._ends[number + 1]].decode(
            errors="surrogateescape"
        )

    def number(self, name: str) -> int | None:
        """The number of this name; None where it was not added."""
        found = self._slots[self._slot(name)]
        return None if found == FREE else found

    def add(self, name: str) -> int:
        """Add a name unless it is there; returns its number."""
        slot = self._slot(name)
        if self._slots[slot] == FREE:
            self._slots[slot] = len(self)
            self._text += name.encode(errors="surrogateescape")
            self._ends.append(len(self._text))
            if 2 * len(self) > len(self._slots):
                self._spread(2 * len(self._slots))
                return len(self) - 1
        return self._slots[slot]

    def _slot(self, name: str) -> int:
        """The slot of the hash table for this name."""
        last = len(self._slots) - 1
        slot = hash(name) & last
        while (number := self._slots[slot]) != FREE and self.item(number) != name:
            slot = (slot + 1) & last
        return slot

    def _spread(self, slots: int) -> None:
        self._slots = array("i", [FREE]) * slots
        for number, name in enumerate(self):
            self._slots[self._slot(name)] = number


def _unpickled(text: bytes, ends: bytes) -> Names:
    """The names from a pickle; the hash table is made again: hashes differ by process."""
    names = Names()
    names._text, names._ends = bytearray(text), array("q", ends)
    names._spread(max(SLOTS, 1 << (2 * len(names)).bit_length()))
    return names


@dataclass(frozen=True, eq=False)
class SomeNames(Collection[str]):
    """Some of ``names``. chosen: (N,) bool, True for these."""

    names: Names
    chosen: NDArray[np.bool_]

    def __len__(self) -> int:
        return int(np.count_nonzero(self.chosen))

    def __iter__(self) -> Iterator[str]:
        return (self.names.item(int(number)) for number in np.flatnonzero(self.chosen))

    def __contains__(self, name: object) -> bool:
        number = self.names.number(name) if isinstance(name, str) else None
        return number is not None and bool(self.chosen[number])


class ByName(Mapping[str, Item]):
    """A mapping from names to few different items, as the water that many frames share."""

    def __init__(self, pairs: Iterable[tuple[str, Item]] = ()) -> None:
        self._names, self._which = Names(), array("i")
        self._items: list[Item] = []
        self._places: dict[int, int] = {}
        for name, item in pairs:
            self.put(name, item)

    def put(self, name: str, item: Item) -> None:
        """Set the item of a name."""
        place = self._places.setdefault(id(item), len(self._items))
        if place == len(self._items):
            self._items.append(item)
        number = self._names.add(name)
        self._which[number : number + 1] = array("i", [place])

    def __reduce__(self) -> "tuple[Callable[..., ByName[Item]], tuple[object, ...]]":
        return _by_name, (self._names, self._which.tobytes(), self._items)

    def __getitem__(self, name: str) -> Item:
        number = self._names.number(name)
        if number is None:
            raise KeyError(name)
        return self._items[self._which[number]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def different(self) -> Sequence[Item]:
        """Every item once."""
        return self._items


def _by_name(names: Names, which: bytes, items: list[Item]) -> ByName[Item]:
    """The mapping from a pickle."""
    found = ByName[Item]()
    found._names, found._which, found._items = names, array("i", which), items
    found._places = {id(item): place for place, item in enumerate(items)}
    return found
