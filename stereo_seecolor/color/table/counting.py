"""Counting the pixels of an image by channel, range and value, on all cores; and how an image is divided among these.

Counts are integers: the same whatever the number of threads. Compiled without numba's own threads, whose simplest layer must not
be entered by two threads at once.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.bins import LOW_BITS, NEAREST_M, RANGE_BINS, range_bits
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import core_pool, cores

U = np.uint64
BLOCK = 2048
"""Pixels at a time: what is known of them stays in the first cache."""
GAP = 8
"""Between the counts of two channels: without, those of equal red and blue are 4096 bytes apart, which processors take for one."""
ZERO, PIXEL = np.int32(0), np.int64(1 << 40)
MOST = 1 << 21
"""Pixels of one part: their places in a level then add up to less than 40 bits."""
LAST = (RANGE_BINS << LOW_BITS) - 1
"""The last place of the last level."""
_FIRST = int(np.float32(NEAREST_M).view(np.int32))
_INFINITY = int(np.float32(np.inf).view(np.int32))
_LOW = (1 << LOW_BITS) - 1


def count(
    image: NDArray[Any], range_m: NDArray[np.floating], values: int, every: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts (3, 256, values) and offset sums (256,) of an image (H, W, 3) and its range map (H, W), of one row in ``every``."""
    flat, bits = np.ascontiguousarray(image).reshape(-1), range_bits(range_m)
    (height, width), shift = range_m.shape, 0 if image.dtype == np.uint8 else 4
    parts = divisions(bits.size // every)
    edges = [height * i // parts // every * every for i in range(parts)] + [height]
    cells = np.empty((parts, RANGE_BINS + 1, 3, values + GAP), np.int64)
    met = np.zeros((parts, 2), np.int64)

    def part(i: int) -> None:
        a, b = edges[i] * width, edges[i + 1] * width
        met[i] = _count(flat[3 * a : 3 * b], bits[a:b], max(width, 1), every, shift, cells[i].reshape(-1))

    spread(part, parts)
    counts, place_sum = np.zeros((3, RANGE_BINS, values), np.int64), np.zeros(RANGE_BINS, np.int64)
    _add_up(cells, met, counts, place_sum)
    return counts, place_sum


def divisions(pixels: int) -> int:
    """Into how many parts to divide so many pixels."""
    return max(1, min(cores(), 8, pixels // 65536), -(-pixels // MOST))


def spread(part: Callable[[int], None], parts: int) -> None:
    """Call ``part`` with 0 to before ``parts``, at once."""
    if parts == 1:
        part(0)
        return
    others = [core_pool().submit(part, i) for i in range(1, parts)]
    part(0)
    for other in others:
        other.result()


@compiled
def place_of(bits):  # type: ignore[no-untyped-def]
    """Where a range is among the levels and inside its own; past the last where it is not known."""
    zero, infinity, first, last = ZERO, np.int32(_INFINITY), np.int32(_FIRST), np.int32(LAST)
    known = (bits > zero) & (bits < infinity)  # NaN, infinities, zero and negative numbers are not
    return min(max(bits - first, zero), last) if known else last + np.int32(1)


@compiled
def _places(bits, places):  # type: ignore[no-untyped-def]
    for i in range(bits.size):  # 32-bit arithmetic and no branch: the compiler does eight at a time
        places[i] = np.uint32(place_of(bits[i]))


@compiled
def span(places, none):  # type: ignore[no-untyped-def]
    """The nearest and the farthest of a block's places that are not ``none``; the nearest is beyond the farthest where all are."""
    nearest, farthest = none, np.uint32(0)
    for i in range(places.size):
        nearest = min(nearest, places[i])
        farthest = max(farthest, places[i] if places[i] != none else np.uint32(0))
    return int(nearest), int(farthest)


@compiled
def _count(image, bits, width, every, shift, cells):  # type: ignore[no-untyped-def]
    """Into ``cells``, flat (257, 3, values + GAP), pixels; red's above 40 bits, and below these the sum of places in a level.

    Of each ``every`` rows that in the middle is counted.
    Gives the levels met, from the first to before the last; the cells of others are left as they were.
    """
    # a flat array and unsigned indices: numba then leaves out its tests for negative ones
    block = np.empty(BLOCK, np.uint32)
    row_size = cells.size // (RANGE_BINS + 1)
    pitch, shift = U(row_size // 3), U(shift)
    low, high = 0, 0
    cells[RANGE_BINS * row_size :] = 0
    for start in range(every // 2 * width, bits.size, every * width):
        for first in range(start, start + width, BLOCK):
            part = bits[first : min(first + BLOCK, start + width)]
            _places(part, block)
            nearest, farthest = span(block[: part.size], np.uint32(LAST + 1))
            if nearest <= farthest and not (low <= nearest >> LOW_BITS and farthest >> LOW_BITS < high):
                low, high = _cleared(cells, row_size, low, high, nearest >> LOW_BITS, (farthest >> LOW_BITS) + 1)
            at = U(3 * first)
            for i in range(part.size):
                place = U(block[i])
                row = (place >> U(LOW_BITS)) * (U(3) * pitch)
                cells[row + (U(image[at]) >> shift)] += PIXEL + np.int64(place & U(_LOW))
                cells[row + pitch + (U(image[at + U(1)]) >> shift)] += 1
                cells[row + pitch + pitch + (U(image[at + U(2)]) >> shift)] += 1
                at += U(3)
    return low, high


@compiled
def _cleared(cells, row_size, low, high, first, end):  # type: ignore[no-untyped-def]
    """The levels with cleared cells, from ``low`` to before ``high``, grown to hold those from ``first`` to before ``end``."""
    low, high = (first, first) if low == high else (low, high)
    cells[min(first, low) * row_size : low * row_size] = 0
    cells[high * row_size : max(end, high) * row_size] = 0
    return min(first, low), max(end, high)


@compiled
def _add_up(cells, met, counts, place_sum):  # type: ignore[no-untyped-def]
    for part in range(cells.shape[0]):
        for level in range(met[part, 0], met[part, 1]):
            for value in range(counts.shape[2]):
                red = cells[part, level, 0, value]
                counts[0, level, value] += red >> 40
                place_sum[level] += red & (PIXEL - 1)
            for channel in range(1, 3):
                for value in range(counts.shape[2]):
                    counts[channel, level, value] += cells[part, level, channel, value]
