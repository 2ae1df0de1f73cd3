"""Counting the pixels of an image by channel, range and value."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.bins import LOW_BITS, NEAREST_M, RANGE_BINS, range_bits
from stereo_seecolor.compute.compiled import compiled

U = np.uint32  # unsigned indices: numba then leaves out its tests for negative ones
LAST = (RANGE_BINS << LOW_BITS) - 1
"""The last position of the last range bin, counted from the first bin."""
_FIRST = np.float32(NEAREST_M).view(np.int32)
_INFINITY = np.float32(np.inf).view(np.int32)


def count(
    image: NDArray[Any], range_m: NDArray[np.floating], values: int, every: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts (3, 256, values) and offset sums (256,) of an image (H, W, 3) and its range map (H, W), of one row in ``every``."""
    counts, offset_sum = np.zeros((3, RANGE_BINS, values), np.int64), np.zeros(RANGE_BINS, np.int64)
    bits = range_bits(range_m).reshape(range_m.shape)
    _count(np.ascontiguousarray(image), bits, every, counts, offset_sum)
    return counts, offset_sum


@compiled
def position_of(bits: Any) -> Any:
    """Where a range, given as its float32 bits, lies among the bins, in steps of its last bit; past LAST where it is not known."""
    known = (bits > np.int32(0)) & (bits < _INFINITY)  # NaN, infinities, zero and negative numbers are not
    return U(min(max(bits - _FIRST, np.int32(0)), np.int32(LAST))) if known else U(LAST + 1)


@compiled
def _count(image: Any, bits: Any, every: int, counts: Any, offset_sum: Any) -> None:
    """Of each ``every`` rows that in the middle is counted."""
    shift = U(0 if image.itemsize == 1 else 4)
    for row in range(every // 2, bits.shape[0], every):
        for column in range(bits.shape[1]):
            position = position_of(bits[row, column])
            if position <= LAST:
                range_bin = position >> U(LOW_BITS)
                offset_sum[range_bin] += position & U((1 << LOW_BITS) - 1)
                for c in range(3):
                    counts[c, range_bin, U(image[row, column, c]) >> shift] += 1
