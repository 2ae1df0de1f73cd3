"""Counts the pixels of an image by channel, range and value."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.moment_table import LOW_BITS, NEAREST_M, RANGE_BINS, range_bits
from stereo_seecolor.compute.compiled import compiled

U, L = np.uint32, np.uint64  # unsigned indices: numba then leaves out its tests for negative ones
LAST = (RANGE_BINS << LOW_BITS) - 1
"""The last position of the last range bin, counted from the first bin."""
_FIRST = np.float32(NEAREST_M).view(np.int32)
_INFINITY = np.float32(np.inf).view(np.int32)
LANES = 4
"""Parallel sums of offsets: neighboring pixels are of one range bin, and a single sum would wait
for its last addition.
"""


def count(
    image: NDArray[Any], range_m: NDArray[np.floating], values: int, every: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts (3, 256, values) and offset sums (256,) of an image (H, W, 3) and its range map (H,
    W), of one row in ``every``.
    """
    counts, offset_sums = (
        np.zeros((3, RANGE_BINS, values), np.int64),
        np.zeros((RANGE_BINS, LANES), np.int64),
    )
    bits = range_bits(range_m).reshape(range_m.shape)
    _count(np.ascontiguousarray(image), bits, every, counts, offset_sums)
    return counts, offset_sums.sum(axis=1)


@compiled
def position_of(bits: Any) -> Any:
    """Position of a range, given as float32 bits, from the first bin's edge, in steps of the last
    bit; LAST + 1 where unknown.
    """
    known = (bits > np.int32(0)) & (
        bits < _INFINITY
    )  # NaN, infinities, zero and negative numbers are not
    return U(min(max(bits - _FIRST, np.int32(0)), np.int32(LAST))) if known else U(LAST + 1)


@compiled
def _count(image: Any, bits: Any, every: int, counts: Any, offset_sums: Any) -> None:
    """Count the middle one of each ``every`` rows. Positions are computed in a loop of their own,
    which the compiler vectorizes.
    """
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
