"""Long sequences in little memory: a million rows of 3 kB take a few megabytes."""

import pickle
import tempfile
import weakref
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from threading import Lock
from typing import IO, Generic, TypeVar

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import OutputError

Item = TypeVar("Item")

CHUNK = 500
"""Items packed together: unpacking 500 rows takes 10 ms. Shorter sequences are not packed."""
IN_MEMORY = 1 << 22
"""Bytes of packed chunks that stay in memory, 15,000 rows; more go to a temporary file, which is
deleted with the process.
"""


@dataclass
class _Open(Generic[Item]):
    """The unpacked chunk. which: its number."""

    which: int = 0
    items: list[Item] = field(default_factory=list)
    changed: bool = False


class Packed(Lazy[Item]):
    """A sequence of picklable items: appended at the end, read or replaced anywhere."""

    def __init__(self) -> None:
        self._file: IO[bytes] = tempfile.SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115  # the next line closes it
        weakref.finalize(self, self._file.close)
        self._starts, self._sizes = array("q"), array("q")
        self._open: _Open[Item] = _Open()
        self._length = 0
        self._lock = Lock()

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[Item]:
        return (self.item(number) for number in range(self._length))

    def item(self, number: int) -> Item:
        """The item of this number."""
        with self._lock:
            return self._chunk(number // CHUNK).items[number % CHUNK]

    def append(self, item: Item) -> None:
        """Append an item. Raises OutputError where neither memory nor disk can hold it."""
        with self._lock:
            chunk = self._chunk(self._length // CHUNK)
            chunk.items.append(item)
            chunk.changed = True
            self._length += 1

    def replace(self, number: int, item: Item) -> None:
        """Replace an item. Raises OutputError as ``append``."""
        with self._lock:
            chunk = self._chunk(number // CHUNK)
            chunk.items[number % CHUNK] = item
            chunk.changed = True

    def _chunk(self, which: int) -> _Open[Item]:
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

    def _read(self, which: int) -> list[Item]:
        self._file.seek(self._starts[which])
        # our own
        found: list[Item] = pickle.loads(zlib.decompress(self._file.read(self._sizes[which])))
        return found
