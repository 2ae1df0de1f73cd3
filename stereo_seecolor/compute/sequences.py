"""Long sequences in little memory: names of frames, rows of a dive, and items made when asked
for.
"""

import pickle
import tempfile
import weakref
import zlib
from abc import abstractmethod
from array import array
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import IO, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import OutputError

# Sequences whose items are read or made when asked for, since those of a dive do not fit into
# memory.

LazyItem = TypeVar("LazyItem", covariant=True)


class Lazy(Sequence[LazyItem]):
    """A sequence whose items ``item`` makes; a slice of it is a list."""

    @abstractmethod
    def item(self, number: int) -> LazyItem:
        """The item of this number, from 0 to the length less 1."""

    @overload
    def __getitem__(self, index: int) -> LazyItem: ...
    @overload
    def __getitem__(self, index: slice) -> list[LazyItem]: ...
    def __getitem__(self, index: int | slice) -> LazyItem | list[LazyItem]:
        if isinstance(index, slice):
            return [self.item(i) for i in range(len(self))[index]]
        return self.item(range(len(self))[index])


class Chosen(Lazy[LazyItem]):
    """Some items of a sequence. numbers: the numbers of these items, in order."""

    def __init__(self, items: Sequence[LazyItem], numbers: Sequence[int]) -> None:
        self._items, self._numbers = items, numbers

    def __len__(self) -> int:
        return len(self._numbers)

    def item(self, number: int) -> LazyItem:
        """The item of this number among those chosen."""
        return self._items[self._numbers[number]]


# Names of a dive's frames in little memory; a name is found by its number, and a number by its
# name.

NamesItem = TypeVar("NamesItem")

SLOTS = 1 << 6
"""Places of the hash table at first; twice as many whenever half of them are taken."""
FREE = -1


class Names(Lazy[str]):
    """Different names in the order in which they were added: 40 bytes each, while a dict takes
    200.
    """

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
    """The names from a pickle; the hash table is made again, since another process has other
    hashes.
    """
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


class ByName(Mapping[str, NamesItem]):
    """A mapping from names to items, with few different items, such as the water that many frames
    share.
    """

    def __init__(self, pairs: Iterable[tuple[str, NamesItem]] = ()) -> None:
        self._names, self._which = Names(), array("i")
        self._items: list[NamesItem] = []
        self._places: dict[int, int] = {}
        for name, item in pairs:
            self.put(name, item)

    def put(self, name: str, item: NamesItem) -> None:
        """Set the item of a name."""
        place = self._places.setdefault(id(item), len(self._items))
        if place == len(self._items):
            self._items.append(item)
        number = self._names.add(name)
        self._which[number : number + 1] = array("i", [place])

    def __reduce__(self) -> "tuple[Callable[..., ByName[NamesItem]], tuple[object, ...]]":
        return _by_name, (self._names, self._which.tobytes(), self._items)

    def __getitem__(self, name: str) -> NamesItem:
        number = self._names.number(name)
        if number is None:
            raise KeyError(name)
        return self._items[self._which[number]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def different(self) -> Sequence[NamesItem]:
        """Every item once."""
        return self._items


def _by_name(names: Names, which: bytes, items: list[NamesItem]) -> ByName[NamesItem]:
    """The mapping from a pickle."""
    found = ByName[NamesItem]()
    found._names, found._which, found._items = names, array("i", which), items
    found._places = {id(item): place for place, item in enumerate(items)}
    return found


# Long sequences in little memory: a million rows of a dive, 3 kB each as objects, take a few
# megabytes.

PackedItem = TypeVar("PackedItem")

CHUNK = 500
"""Items that are packed together: unpacking 500 rows takes some 10 ms. Shorter sequences are not
packed.
"""
IN_MEMORY = 1 << 22
"""Bytes of packed chunks that stay in memory, 15,000 rows; more go to a temporary file, which is
deleted with the process.
"""


@dataclass
class _Open(Generic[PackedItem]):
    """The unpacked chunk. which: its number."""

    which: int = 0
    items: list[PackedItem] = field(default_factory=list)
    changed: bool = False


class Packed(Lazy[PackedItem]):
    """A sequence of picklable items: appended at the end, and read or replaced anywhere; fast if
    accessed in order.
    """

    def __init__(self, items: Iterable[PackedItem] = ()) -> None:
        self._file: IO[bytes] = tempfile.SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115  # the next line closes it
        weakref.finalize(self, self._file.close)
        self._starts, self._sizes = array("q"), array("q")
        self._open: _Open[PackedItem] = _Open()
        self._length = 0
        self._lock = Lock()
        for item in items:
            self.append(item)

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[PackedItem]:
        return (self.item(number) for number in range(self._length))

    def item(self, number: int) -> PackedItem:
        """The item of this number."""
        with self._lock:
            return self._chunk(number // CHUNK).items[number % CHUNK]

    def append(self, item: PackedItem) -> None:
        """Append an item. Raises OutputError where it fits neither into memory nor onto the
        disk.
        """
        with self._lock:
            chunk = self._chunk(self._length // CHUNK)
            chunk.items.append(item)
            chunk.changed = True
            self._length += 1

    def replace(self, number: int, item: PackedItem) -> None:
        """Replace an item. Raises OutputError as ``append``."""
        with self._lock:
            chunk = self._chunk(number // CHUNK)
            chunk.items[number % CHUNK] = item
            chunk.changed = True

    def _chunk(self, which: int) -> _Open[PackedItem]:
        """Unpack a chunk; the one that was unpacked before is packed again if it was changed."""
        if which != self._open.which:
            if self._open.changed:
                self._write(self._open.which, zlib.compress(pickle.dumps(self._open.items), 1))
            self._open = _Open(which, self._read(which) if which < len(self._starts) else [])
        return self._open

    def _write(self, which: int, content: bytes) -> None:
        try:
            start = self._file.seek(0, 2)
            self._file.write(content)
        except OSError as error:
            raise OutputError(
                f"{tempfile.gettempdir()}: cannot be written: {error.strerror or error}: free the "
                "place, or name another in TMPDIR"
            ) from error
        self._starts[which : which + 1] = array("q", [start])
        self._sizes[which : which + 1] = array("q", [len(content)])

    def _read(self, which: int) -> list[PackedItem]:
        self._file.seek(self._starts[which])
        # our own
        found: list[PackedItem] = pickle.loads(zlib.decompress(self._file.read(self._sizes[which])))
        return found
