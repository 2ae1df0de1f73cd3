"""Counts the pixels of an image by channel, range and value: its moment table."""

from typing import Any

import numpy as np

from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_bins import LOW_BITS, NEAREST_M, RANGE_BINS, range_bits
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.errors import ColorError
from stereo_seecolor.records import Image, Map

U, L = np.uint32, np.uint64  # unsigned indices: numba then leaves out its tests for negative ones
LAST = (RANGE_BINS << LOW_BITS) - 1
"""The last position of the last range bin, counted from the first bin."""
FIRST = np.float32(NEAREST_M).view(np.int32)
INFINITY = np.float32(np.inf).view(np.int32)
LANES = 4
"""Parallel sums of offsets: neighbors share a bin, and would wait for each other."""


def measure(image: Image, range_m: Map, every: int = 1) -> MomentTable:
    """Count the pixels of an image (H, W, 3), uint8 or uint16, with a range (H, W), float32 meters
    (finite, above 0), in the middle row of each ``every`` rows; return the moment table. Raises
    ColorError for other shapes or types.
    """
    check_pair(image, range_m)
    table, lanes = MomentTable.empty(8 * image.itemsize), np.zeros((RANGE_BINS, LANES), np.int64)
    bits = range_bits(range_m).reshape(range_m.shape)
    _count(np.ascontiguousarray(image), bits, every, table.counts, lanes)
    return MomentTable(table.counts, lanes.sum(axis=1), table.bit_depth)


def check_pair(image: Image, range_m: Map) -> None:
    """Raise ColorError if an image or its range map has a wrong shape or type."""
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
    """The position of a range (float32 bits) from the edge of the first bin; LAST + 1 = unknown."""
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
