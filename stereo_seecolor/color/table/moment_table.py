"""Moment tables: the number of pixels of each channel with each range and value.

The mean range of each range bin is exact, stored as an integer sum.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.range_bins import (
    LOW_BITS,
    RANGE_BINS,
    VALUE_BINS,
    bin_values,
    range_edges_m,
)
from stereo_seecolor.files.deflate import deflated


@dataclass(frozen=True, eq=False, repr=False)
class MomentTable:
    """A joint histogram of range and value for each channel: exact for every loss that is a sum
    over pixels of f(c, z, I_c).

    counts: (3, 256, V) int64, pixels of R, G, B in each bin of range and value; V = 256 (8 bit) or
    4096 (16 bit).
    offset_sum: (256,) int64, sum over a range bin's pixels of their offset inside the bin, 0..2**18
    - 1.
    bit_depth: 8 or 16, the image's.
    """

    counts: NDArray[np.int64]
    offset_sum: NDArray[np.int64]
    bit_depth: int

    @classmethod
    def empty(cls, bit_depth: int = 8) -> "MomentTable":
        """Make an empty table."""
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
        """Return the (256,) number of pixels in each range bin."""
        return np.asarray(self.counts[0].sum(axis=1))

    @cached_property
    def range_m(self) -> NDArray[np.float64]:
        """The (256,) mean range of the pixels of each bin, meters; the center of an empty bin."""
        pixels, edges = self.pixels, range_edges_m()
        offset = np.where(pixels > 0, self.offset_sum / np.maximum(pixels, 1) / 2**LOW_BITS, 0.5)
        return np.asarray(edges[:-1] + offset * np.diff(edges))

    @property
    def median_range_m(self) -> float | None:
        """The median range of all pixels, to a bin's width, meters; None for an empty table."""
        below = np.cumsum(self.pixels)
        return float(self.range_m[np.searchsorted(below, below[-1] / 2)]) if below[-1] else None

    @property
    def values(self) -> NDArray[np.float64]:
        """The (V,) value of each value bin, fraction of full scale, encoded as in the image."""
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
        """Pack the counts above zero, 12 bytes each: 16-bit tables of 25 MB take some 3 MB."""
        cells = np.flatnonzero(self.counts)
        header = np.array([self.bit_depth, cells.size], "<i8")
        return b"".join(
            part.tobytes()
            for part in (header, self.offset_sum, self.counts.ravel()[cells], cells.astype("<u4"))
        )

    @classmethod
    def unpacked(cls, content: bytes) -> "MomentTable":
        """Unpack a table of ``packed``."""
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
