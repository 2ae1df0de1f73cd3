"""Moment tables: how many pixels of each channel have each range and each value. All that the losses need to know of an image.

A level of range is the leading bits of the float32 number: 32 levels an octave from 1/8 m to 32 m, a relative step of 1.6 to 3.1 %,
the same for every frame of every run, so that tables add. Inside a level the mean range is kept exactly, as an integer sum.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Image, Map

LEVELS = 256
VALUES = {8: 256, 16: 4096}
"""Bins of value by bit depth; 16-bit images are told apart to 12 bits (more than a camera's sensor gives)."""

NEAREST_M, FARTHEST_M = 0.125, 32.0
"""Ranges outside count as these."""

LOW_BITS = 18
"""A level is what remains of a float32 range's bits, counted from those of NEAREST_M, after a shift by this many."""


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
        return cls(np.zeros((3, LEVELS, VALUES[bit_depth]), np.int64), np.zeros(LEVELS, np.int64), bit_depth)

    @cached_property
    def pixels(self) -> NDArray[np.int64]:
        """(256,) pixels at each level."""
        return np.asarray(self.counts[0].sum(axis=1))

    @cached_property
    def range_m(self) -> NDArray[np.float64]:
        """(256,) mean range of each level's pixels, meters; the level's center where it has none."""
        pixels, edges = self.pixels, level_edges_m()
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
        if table.bit_depth not in VALUES or table.counts.shape != (3, LEVELS, VALUES[table.bit_depth]):
            raise ColorError(f"{file}: is not a moment table of this version: counts {table.counts.shape}, {table.bit_depth} bit")
        return table

    def _like(self, other: "MomentTable") -> "MomentTable":
        """This table, with the values of 8 bits where the other has no more."""
        if self.bit_depth <= other.bit_depth:
            return self
        return MomentTable(self.counts.reshape(3, LEVELS, VALUES[8], -1).sum(axis=3), self.offset_sum, 8)


def measure(image: Image, range_m: Map, device: str = "cpu", every: int = 1) -> MomentTable:
    """The moment table of an image's pixels with a known range (finite, above 0).

    image: (H, W, 3) uint8 or uint16. range_m: (H, W) float32 meters. device: cuda counts there, all else on the processor's cores.
    every: of so many rows that in the middle is counted.
    Raises ColorError for other shapes or types, DeviceError where CUDA is asked for and absent.
    """
    check_pair(image, range_m)
    depth = 8 if image.dtype == np.uint8 else 16
    if device == "cuda":
        from stereo_seecolor.color.device import find_device
        from stereo_seecolor.color.render import tensors

        rows = slice(every // 2, None, every)
        counts, offset_sum = tensors.count(image[rows], range_m[rows], VALUES[depth], find_device(device))
    else:
        from stereo_seecolor.color.table import counting

        counts, offset_sum = counting.count(image, range_m, VALUES[depth], every)
    return MomentTable(counts, offset_sum, depth)


def check_pair(image: Image, range_m: Map) -> None:
    """ColorError where an image and a range map cannot be of the same view."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype not in (np.uint8, np.uint16):
        raise ColorError(f"image of shape {image.shape} and type {image.dtype}: needs (H, W, 3), uint8 or uint16")
    if range_m.shape != image.shape[:2]:
        raise ColorError(
            f"range map of {range_m.shape[1::-1]} pixels for an image of {image.shape[1::-1]}: the two must be the same size"
        )


def range_bits(range_m: NDArray[np.floating]) -> NDArray[np.int32]:
    """The bits of a map's ranges as float32, row after row, (H*W,) int32."""
    return np.ascontiguousarray(range_m, dtype=np.float32).reshape(-1).view(np.int32)


def level_edges_m() -> NDArray[np.float64]:
    """(257,) the edges of the levels, meters."""
    first = np.float32(NEAREST_M).view(np.int32)
    bits = first + (np.arange(LEVELS + 1, dtype=np.int32) << LOW_BITS)
    return bits.astype(np.int32).view(np.float32).astype(np.float64)


def bin_values(bit_depth: int) -> NDArray[np.float64]:
    """(V,) the value of each bin as a share of full scale: v/255, or the middle of sixteen neighbors of 65535."""
    if bit_depth == 8:
        return np.arange(256) / 255.0
    return np.asarray((np.arange(4096) * 16 + 7.5) / 65535.0)
