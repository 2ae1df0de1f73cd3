"""Looks up the displayed values of 8-bit pixels by range bin and value.

It does not use numba's threads: two threads must not enter their simplest layer at once.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.water_gains import FINE, FINE_BINS
from stereo_seecolor.color.table.counting import L, U, position_of
from stereo_seecolor.color.table.range_bins import LOW_BITS
from stereo_seecolor.compute.compiled import compiled

FINE_SHIFT = LOW_BITS - FINE.bit_length() + 1
"""A position shifted by this many bits is a fine range bin."""
ROW = 3 * 256
"""Entries of a range bin in a look-up table."""
BLOCK = 4096
"""Pixels that are looked up together: their three channels fit into the first-level cache."""


class Shown(NamedTuple):
    """image (N, 3): encoded, 0 where the range is unknown. unknown (N,). unrecoverable (N,): noise
    limits the gain, or the camera clipped the pixel.
    """

    image: NDArray[Any]
    unknown: NDArray[np.bool_]
    unrecoverable: NDArray[np.bool_]


@compiled
def fine_bins(bits: Any, fine: Any, unknown: Any) -> Any:
    """Write fine range bins (N,) of float32 bits of ranges, FINE_BINS where unknown.

    Returns the nearest and farthest bin (nearest > farthest for none), and the number of known
    ranges.
    """
    nearest, farthest, known = np.uint32(FINE_BINS), np.uint32(0), bits.size
    for i in range(bits.size):
        fine[i] = position_of(bits[i]) >> U(FINE_SHIFT)
        unknown[i] = fine[i] == np.uint32(FINE_BINS)
    for i in range(bits.size):
        nearest = min(nearest, fine[i])
        farthest = max(farthest, fine[i] * np.uint32(not unknown[i]))
        known -= unknown[i]
    return np.int64(nearest), np.int64(farthest), known


@compiled
def look_up(
    image: Any,
    bright: Any,
    fine: Any,
    table: Any,
    roll_off: Any,
    limits: Any,
    special: Any,
    out: Any,
) -> Any:
    """Write the displayed values (N * 3,) of 8-bit pixels; 0 where the range is unknown.

    table (1025 * 768,): displayed values by fine range bin, channel and value; or codes, to be
    multiplied by a factor for the greatest code of the pixel. roll_off: factors (65536,), empty if
    the table contains values; and the number to subtract.
    limits: bins (1025,) that must be computed, and the least value in ``bright`` (N * 3,) of a
    pixel that must be computed. Writes the indices of these pixels into ``special``, and returns
    their number.
    """
    (factors, zero), (capped, near), number = roll_off, limits, L(0)
    codes = np.empty(3 * BLOCK, table.dtype)
    by_pixel = np.empty(BLOCK, np.float32)
    first_capped = np.uint32(FINE_BINS)
    for i in range(FINE_BINS):
        if capped[i]:
            first_capped = min(first_capped, np.uint32(i))
    for start in range(0, fine.size, BLOCK):
        end = min(start + BLOCK, fine.size)
        pixels = image[3 * start : 3 * end]
        bins = fine[start:end]
        shown = out[3 * start : 3 * end]
        if factors.size == 0:
            _take(pixels, bins, table, shown)
        else:
            _take(pixels, bins, table, codes)
            _display(codes, factors, zero, by_pixel, shown)
        lit = bright[3 * start : 3 * end]
        highest, farthest = lit[0], np.uint32(0)
        for i in range(lit.size):
            highest = max(highest, lit[i])
        for i in range(bins.size):
            farthest = max(farthest, bins[i] * np.uint32(bins[i] != np.uint32(FINE_BINS)))
        if highest >= near or farthest >= first_capped:
            for i in range(bins.size):
                special[number] = start + i
                must = (
                    capped[L(bins[i])]
                    or max(lit[3 * i], max(lit[3 * i + 1], lit[3 * i + 2])) >= near
                )
                number += L(must and bins[i] != np.uint32(FINE_BINS))
    return number


@compiled
def _take(pixels: Any, fine: Any, table: Any, out: Any) -> None:
    """Look up 8-bit values (N * 3,)."""
    at = L(0)
    for i in range(fine.size):
        row = L(fine[i]) * L(ROW)
        out[at] = table[row + L(pixels[at])]
        out[at + L(1)] = table[row + L(256) + L(pixels[at + L(1)])]
        out[at + L(2)] = table[row + L(512) + L(pixels[at + L(2)])]
        at += L(3)


@compiled
def _display(codes: Any, factors: Any, zero: Any, by_pixel: Any, out: Any) -> None:
    """Write values of codes (N * 3,); a second loop, so that the compiler vectorizes it."""
    for i in range(out.size // 3):
        by_pixel[i] = factors[L(max(codes[3 * i], max(codes[3 * i + 1], codes[3 * i + 2])))]
    for i in range(out.size // 3):
        for c in range(3):
            code = np.float32(codes[3 * i + c]) * by_pixel[i] - zero
            out[3 * i + c] = np.int32(min(max(code, np.float32(0)), np.float32(255)))


@compiled
def count_full(values: Any, full: int) -> Any:
    """Count the pixels (N * 3,) with a channel at full scale; 32 bits vectorize."""
    number = np.int32(0)
    for i in range(values.size // 3):
        number += np.int32(max(values[3 * i], max(values[3 * i + 1], values[3 * i + 2])) == full)
    return number
