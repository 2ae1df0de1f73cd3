"""The two loops that touch every pixel, on all cores. Integer sums: the same result whatever the number of threads."""

from typing import Any

import numpy as np
from numba import get_num_threads, njit, prange
from numpy.typing import NDArray

from stereo_seecolor.color.tables import LEVELS, LOW_BITS, NEAREST_M

_FIRST = int(np.float32(NEAREST_M).view(np.int32))
_INFINITY = int(np.float32(np.inf).view(np.int32))
_LAST = (LEVELS << LOW_BITS) - 1
_LOW = (1 << LOW_BITS) - 1


def count(image: NDArray[Any], bits: NDArray[np.int32], values: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts (3, 256, values) and offset sums (256,) of (N, 3) pixels with the (N,) bits of their ranges."""
    shift = 0 if image.dtype == np.uint8 else 4
    counts, offset_sum = _count(np.ascontiguousarray(image), bits, values, shift, get_num_threads())
    return counts, offset_sum


@njit(parallel=True, cache=True, nogil=True)
def _count(image, bits, values, shift, threads):  # type: ignore[no-untyped-def]  # pragma: no cover
    parts = np.zeros((threads, 3, LEVELS, values), np.int32)
    sums = np.zeros((threads, LEVELS), np.int64)
    step = (bits.size + threads - 1) // threads
    for part in prange(threads):
        red, green, blue, offset_sum = parts[part, 0], parts[part, 1], parts[part, 2], sums[part]
        for i in range(part * step, min((part + 1) * step, bits.size)):
            if 0 < bits[i] < _INFINITY:  # positive and finite: NaN, infinities, zero and negative numbers are outside
                offset = min(max(bits[i] - _FIRST, 0), _LAST)
                level = offset >> LOW_BITS
                offset_sum[level] += offset & _LOW
                red[level, image[i, 0] >> shift] += 1
                green[level, image[i, 1] >> shift] += 1
                blue[level, image[i, 2] >> shift] += 1
    counts = np.zeros((3, LEVELS, values), np.int64)
    for level in prange(LEVELS):
        for part in range(threads):
            for channel in range(3):
                for value in range(values):
                    counts[channel, level, value] += parts[part, channel, level, value]
    return counts, sums.sum(axis=0)
