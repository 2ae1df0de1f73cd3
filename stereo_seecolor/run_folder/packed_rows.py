"""The rows of a dive of any length in little memory: a row takes 3 kB as an object, and some 250 bytes packed."""

import pickle
import zlib
from collections.abc import Iterator

from stereo_seecolor.compute.lazy import Lazy
from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.records import FrameRow

CHUNK = 500
"""Rows that are packed together: unpacking them takes some 10 ms, and dives of fewer are not packed at all."""


class PackedRows(Lazy[FrameRow]):
    """Rows that are added at the end, and read or replaced anywhere; fast where that goes through them in order."""

    def __init__(self) -> None:
        self._packed: list[bytes] = []
        self._open: tuple[int, list[FrameRow], bool] = (0, [], False)
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[FrameRow]:
        return (self.item(number) for number in range(self._length))

    def item(self, number: int) -> FrameRow:
        """The row of this number."""
        return self._chunk(number // CHUNK)[number % CHUNK]

    def append(self, row: FrameRow) -> None:
        """One more row."""
        self._chunk(self._length // CHUNK).append(row)
        self._length += 1
        self._changed()

    def replace(self, number: int, row: FrameRow) -> None:
        """Another row in the place of one."""
        self._chunk(number // CHUNK)[number % CHUNK] = row
        self._changed()

    def _changed(self) -> None:
        which, rows, _ = self._open
        self._open = which, rows, True

    def _chunk(self, which: int) -> list[FrameRow]:
        """The rows of one chunk, unpacked; the one that was before is packed again if it was changed."""
        before, rows, changed = self._open
        if which != before:
            if changed:
                self._packed[before : before + 1] = [deflated(pickle.dumps(rows))]
            rows = pickle.loads(zlib.decompress(self._packed[which])) if which < len(self._packed) else []  # our own
            self._open = which, rows, False
        return rows
