"""Moment tables: the pixels of each channel with each range and value, all that losses need.

The mean range of each range bin is kept exactly, as an integer sum.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.errors import ColorError
from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.records import Image, Map

# The bins of a moment table: by range, 32 an octave, and by value.
#
# A range bin is the leading bits of the float32 number: from 1/8 m to 32 m, 1.6 to 3.1 % wide,
# the same for every frame of every run, so that tables add.

RANGE_BINS = 256
VALUE_BINS = {8: 256, 16: 4096}
"""Value bins by bit depth; 16 bits are counted to 12, more than a sensor gives."""

NEAREST_M = 0.125
"""Near edge of the first bin; the last ends at 32 m. Ranges outside count in these two."""

LOW_BITS = 18
"""A range bin is a float32 range's bits above those of NEAREST_M, shifted by this many."""


def range_bits(range_m: NDArray[np.floating]) -> NDArray[np.int32]:
    """The bits of a map's ranges as float32, row after row, (H*W,) int32."""
    return np.ascontiguousarray(range_m, dtype=np.float32).reshape(-1).view(np.int32)


def range_edges_m() -> NDArray[np.float64]:
    """(257,) the edges of the range bins, meters."""
    first = np.float32(NEAREST_M).view(np.int32)
    bits = first + (np.arange(RANGE_BINS + 1, dtype=np.int32) << LOW_BITS)
    return bits.astype(np.int32).view(np.float32).astype(np.float64)


def bin_values(bit_depth: int) -> NDArray[np.float64]:
    """(V,) each bin's fraction of full scale: v/255, or the middle of 16 neighbors of 65535."""
    if bit_depth == 8:
        return np.arange(256) / 255.0
    return np.asarray((np.arange(4096) * 16 + 7.5) / 65535.0)


@dataclass(frozen=True, eq=False, repr=False)
class MomentTable:
    """A joint histogram of range and value for each channel: exact for every loss that is a sum
    over pixels of f(c, z, I_c).

    counts: (3, 256, V) int64, pixels of channel R, G, B in each bin of range and value; V = 256 (8
    bit) or 4096 (16 bit).
    offset_sum: (256,) int64, sum over a range bin's pixels of their offset inside the bin, 0..2**18
    - 1.
    bit_depth: 8 or 16, the image's.
    """

    counts: NDArray[np.int64]
    offset_sum: NDArray[np.int64]
    bit_depth: int

    @classmethod
    def empty(cls, bit_depth: int = 8) -> "MomentTable":
        """The table of no pixel."""
        return cls(
            np.zeros((3, RANGE_BINS, VALUE_BINS[bit_depth]), np.int64),
            np.zeros(RANGE_BINS, np.int64),
            bit_depth,
        )

    def __reduce__(self) -> tuple[Callable[[bytes], "MomentTable"], tuple[bytes]]:
        return _inflated, (deflated(self.packed()),)

    def __repr__(self) -> str:
        """Pixels, bit depth and the ranges that they span."""
        occupied = self.range_m[self.pixels > 0]
        span = f", {occupied[0]:.2f} to {occupied[-1]:.2f} m" if occupied.size else ""
        return f"MomentTable({int(self.pixels.sum())} pixels, {self.bit_depth} bit{span})"

    @cached_property
    def pixels(self) -> NDArray[np.int64]:
        """(256,) pixels in each range bin."""
        return np.asarray(self.counts[0].sum(axis=1))

    @cached_property
    def range_m(self) -> NDArray[np.float64]:
        """(256,) mean range of each bin's pixels, meters; the bin's center where it has none."""
        pixels, edges = self.pixels, range_edges_m()
        offset = np.where(pixels > 0, self.offset_sum / np.maximum(pixels, 1) / 2**LOW_BITS, 0.5)
        return np.asarray(edges[:-1] + offset * np.diff(edges))

    @property
    def median_range_m(self) -> float | None:
        """Median range of all pixels, to a bin's width, meters; None for an empty table."""
        below = np.cumsum(self.pixels)
        return float(self.range_m[np.searchsorted(below, below[-1] / 2)]) if below[-1] else None

    @property
    def values(self) -> NDArray[np.float64]:
        """(V,) value of each value bin, as a fraction of full scale, encoded as in the image."""
        return bin_values(self.bit_depth)

    def __add__(self, other: "MomentTable") -> "MomentTable":
        """The table of both tables' pixels; with 8-bit values where one of them has."""
        a, b = self._like(other), other._like(self)
        return MomentTable(a.counts + b.counts, a.offset_sum + b.offset_sum, a.bit_depth)

    def __sub__(self, other: "MomentTable") -> "MomentTable":
        """The table without the other's pixels, which must have been added before."""
        a, b = self._like(other), other._like(self)
        return MomentTable(a.counts - b.counts, a.offset_sum - b.offset_sum, a.bit_depth)

    def packed(self) -> bytes:
        """The counts above zero, 12 bytes each: 16-bit tables of 25 MB take some 3."""
        cells = np.flatnonzero(self.counts)
        header = np.array([self.bit_depth, cells.size], "<i8")
        return b"".join(
            part.tobytes()
            for part in (header, self.offset_sum, self.counts.ravel()[cells], cells.astype("<u4"))
        )

    @classmethod
    def unpacked(cls, content: bytes) -> "MomentTable":
        """The table from ``packed``."""
        bit_depth, number = (int(value) for value in np.frombuffer(content, "<i8", 2))
        offset_sum, counts = np.split(
            np.frombuffer(content, "<i8", RANGE_BINS + number, 16), [RANGE_BINS]
        )
        table = cls(
            np.zeros((3, RANGE_BINS, VALUE_BINS[bit_depth]), np.int64), offset_sum, bit_depth
        )
        table.counts.reshape(-1)[
            np.frombuffer(content, "<u4", number, 16 + 8 * (RANGE_BINS + number))
        ] = counts
        return table

    def _like(self, other: "MomentTable") -> "MomentTable":
        """This table, reduced to 8-bit values where the other has these."""
        if self.bit_depth <= other.bit_depth:
            return self
        return MomentTable(
            self.counts.reshape(3, RANGE_BINS, VALUE_BINS[8], -1).sum(axis=3), self.offset_sum, 8
        )


def _inflated(content: bytes) -> MomentTable:
    return MomentTable.unpacked(zlib.decompress(content))


# Counts the pixels of an image by channel, range and value: its moment table.

U, L = np.uint32, np.uint64  # unsigned indices: numba then leaves out its tests for negative ones
LAST = (RANGE_BINS << LOW_BITS) - 1
"""The last position of the last range bin, counted from the first bin."""
FIRST = np.float32(NEAREST_M).view(np.int32)
INFINITY = np.float32(np.inf).view(np.int32)
LANES = 4
"""Parallel sums of offsets: neighbors share a bin, and one sum would wait for itself."""


def measure(image: Image, range_m: Map, every: int = 1) -> MomentTable:
    """The moment table of an image's pixels with a known range (finite, above 0).

    image: (H, W, 3) uint8 or uint16. range_m: (H, W) float32 meters.
    every: only the middle one of each ``every`` rows is counted.
    Raises ColorError for other shapes or types.
    """
    check_pair(image, range_m)
    table, lanes = MomentTable.empty(8 * image.itemsize), np.zeros((RANGE_BINS, LANES), np.int64)
    bits = range_bits(range_m).reshape(range_m.shape)
    _count(np.ascontiguousarray(image), bits, every, table.counts, lanes)
    return MomentTable(table.counts, lanes.sum(axis=1), table.bit_depth)


def check_pair(image: Image, range_m: Map) -> None:
    """Raise ColorError where an image or its range map has a wrong shape or type."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype not in (np.uint8, np.uint16):
        raise ColorError(
            f"image of shape {image.shape} and type {image.dtype}: needs (H, W, 3), uint8 or uint16"
        )
    if range_m.shape != image.shape[:2]:
        raise ColorError(
            f"range map of {range_m.shape[1::-1]} pixels for an image of {image.shape[1::-1]}: "
            "the two must be the same size"
        )


@compiled
def position_of(bits: Any) -> Any:
    """Position of a range (float32 bits) from the first bin's edge; LAST + 1 where unknown."""
    # NaN, infinities, zero and negative numbers are not
    known = (bits > np.int32(0)) & (bits < INFINITY)
    return U(min(max(bits - FIRST, np.int32(0)), np.int32(LAST))) if known else U(LAST + 1)


@compiled
def _count(image: Any, bits: Any, every: int, counts: Any, offset_sums: Any) -> None:
    """Count the middle of each ``every`` rows. Positions have their own loop, to be vectorized."""
    shift, positions = L(0 if image.itemsize == 1 else 4), np.empty(bits.shape[1], np.uint32)
    for row in range(every // 2, bits.shape[0], every):
        pixels, row_bits = image[row], bits[row]
        for column in range(row_bits.size):
            positions[column] = position_of(row_bits[column])
        for column in range(row_bits.size):
            position = positions[column]
            if position <= LAST:
                range_bin = L(position >> U(LOW_BITS))
                offset_sums[range_bin, L(column) % L(LANES)] += position & U((1 << LOW_BITS) - 1)
                for c in range(3):
                    counts[L(c), range_bin, L(pixels[L(column), L(c)]) >> shift] += 1
