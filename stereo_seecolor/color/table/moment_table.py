"""Moment tables: how many pixels of each channel have each range and each value. All that the losses need to know of an image.

Inside a range bin the mean range is kept exactly, as an integer sum.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.bins import LOW_BITS, RANGE_BINS, VALUE_BINS, bin_values, range_edges_m
from stereo_seecolor.errors import ColorError


@dataclass(frozen=True, eq=False)
class MomentTable:
    """The joint histogram of range and value, one a channel: exact for every loss that is a sum over pixels of f(c, z, I_c).

    counts: (3, 256, V) int64, pixels of channel R, G, B at each level of range and value; V = 256 (8 bit) or 4096 (16 bit).
    offset_sum: (256,) int64, sum over a level's pixels of their place inside the level, 0..2**18 - 1.
    bit_depth: 8 or 16, the image's.
    """

    counts: NDArray[np.int64]
    offset_sum: NDArray[np.int64]
    bit_depth: int

    @classmethod
    def empty(cls, bit_depth: int = 8) -> "MomentTable":
        """The table of no pixel."""
        return cls(np.zeros((3, RANGE_BINS, VALUE_BINS[bit_depth]), np.int64), np.zeros(RANGE_BINS, np.int64), bit_depth)

    @cached_property
    def pixels(self) -> NDArray[np.int64]:
        """(256,) pixels at each level."""
        return np.asarray(self.counts[0].sum(axis=1))

    @cached_property
    def range_m(self) -> NDArray[np.float64]:
        """(256,) mean range of each level's pixels, meters; the level's center where it has none."""
        pixels, edges = self.pixels, range_edges_m()
        place = np.where(pixels > 0, self.offset_sum / np.maximum(pixels, 1) / 2**LOW_BITS, 0.5)
        return np.asarray(edges[:-1] + place * np.diff(edges))

    @property
    def values(self) -> NDArray[np.float64]:
        """(V,) what each bin's value is as a share of full scale, as the camera encoded it."""
        return bin_values(self.bit_depth)

    def __add__(self, other: "MomentTable") -> "MomentTable":
        """The table of both images' pixels; of 8-bit values where one of them is."""
        a, b = self._like(other), other._like(self)
        return MomentTable(a.counts + b.counts, a.offset_sum + b.offset_sum, a.bit_depth)

    def __sub__(self, other: "MomentTable") -> "MomentTable":
        """The table without the other's pixels, which must have been added before."""
        a, b = self._like(other), other._like(self)
        return MomentTable(a.counts - b.counts, a.offset_sum - b.offset_sum, a.bit_depth)

    def save(self, file: BinaryIO | Path) -> None:
        """Write as compressed npz."""
        np.savez_compressed(file, counts=self.counts, offset_sum=self.offset_sum, bit_depth=self.bit_depth)

    @classmethod
    def load(cls, file: BinaryIO | Path) -> "MomentTable":
        """Read what ``save`` wrote. Raises ColorError where it is something else."""
        try:
            with np.load(file, allow_pickle=False) as content:
                table = cls(content["counts"], content["offset_sum"], int(content["bit_depth"]))
        except (OSError, KeyError, ValueError, EOFError) as error:
            raise ColorError(f"{file}: is not a moment table: {error}") from error
        if table.bit_depth not in VALUE_BINS or table.counts.shape != (3, RANGE_BINS, VALUE_BINS[table.bit_depth]):
            raise ColorError(f"{file}: is not a moment table of this version: counts {table.counts.shape}, {table.bit_depth} bit")
        return table

    def _like(self, other: "MomentTable") -> "MomentTable":
        """This table, with the values of 8 bits where the other has no more."""
        if self.bit_depth <= other.bit_depth:
            return self
        return MomentTable(self.counts.reshape(3, RANGE_BINS, VALUE_BINS[8], -1).sum(axis=3), self.offset_sum, 8)
