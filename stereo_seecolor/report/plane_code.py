"""Whole numbers on a pixel grid in few bytes, for the page.

Each is predicted from its left, upper and upper left neighbors (the median edge detector of LOCO-I,
Weinberger et al. 2000). The errors go bit by bit through a binary arithmetic coder (Witten et al.
1987), whose probabilities adapt to the differences between the neighbors. The page decodes them in
web/src/codes.ts.
"""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled

UNKNOWN = -1
"""A pixel that may become any number: the page masks it."""
CLIP = 2
"""Differences between neighbors beyond this count as equal."""
MOST_AROUND = 12
"""Sums of such differences beyond this count as equal."""
UNARY = 20
"""From here on, the bits of an error are written, after their count."""
SHIFT = 6
"""A probability moves by 2**-SHIFT of the way: it averages some 64 pixels."""


def coded(codes: NDArray[np.integer] | NDArray[np.bool_]) -> bytes:
    """Bytes of codes (H, W) of less than 2^16, where UNKNOWN saves bytes."""
    content = np.empty(6 * codes.size + 64, np.uint8)  # 36 bits write the largest error
    sizes = 2 * (2 * CLIP + 1) ** 3, (MOST_AROUND + 1) * UNARY, 64
    chances = tuple(np.full(size, 1 << 15, np.int64) for size in sizes)
    rows, ends = np.zeros((2, codes.shape[1]), np.int64), np.array([0, 0xFFFFFFFF, 0], np.int64)
    length = _code(np.ascontiguousarray(codes, np.int32), chances, rows, ends, content)
    return content[:length].tobytes()


@compiled
def _write(bit, chances, which, ends, content):  # type: ignore[no-untyped-def]
    """Write a bit, and adapt its chance. bit: always bool, since each type is compiled apart. ends:
    (3,) of the coder's interval, and bytes written.
    """
    chance = chances[which]
    middle = ends[0] + (((ends[1] - ends[0]) * chance) >> 16)
    if bit:
        ends[1] = middle
        chances[which] = chance + ((65536 - chance) >> SHIFT)
    else:
        ends[0] = middle + 1
        chances[which] = chance - (chance >> SHIFT)
    while (ends[0] ^ ends[1]) < 1 << 24:  # the highest of 4 bytes is decided
        content[ends[2]] = ends[1] >> 24
        ends[2] += 1
        ends[0] = (ends[0] << 8) & 0xFFFFFFFF
        ends[1] = ((ends[1] << 8) & 0xFFFFFFFF) | 255


@compiled
def _clipped(difference):  # type: ignore[no-untyped-def]
    return min(max(difference, -CLIP), CLIP) + CLIP


@compiled
def _write_size(rest, around, further, bits, ends, content):  # type: ignore[no-untyped-def]
    """Write how much larger than one an error is. around: sum of the neighbors' differences."""
    first = min(around, MOST_AROUND) * UNARY
    for place in range(min(rest + 1, UNARY)):
        _write(place < rest, further, first + place, ends, content)
    if rest >= UNARY:
        _write_large(rest - UNARY + 1, bits, ends, content)


@compiled
def _write_large(number, bits, ends, content):  # type: ignore[no-untyped-def]
    """Write how many bits follow the first one of a number, and these."""
    size, longer = -1, True
    while longer:
        size += 1
        longer = number >> (size + 1) > 0
        _write(longer, bits, size, ends, content)
    for place in range(size - 1, -1, -1):
        _write((number >> place) & 1 > 0, bits, 32 + place, ends, content)


@compiled
def _code(codes, chances, rows, ends, content):  # type: ignore[no-untyped-def]
    """Fill ``content``; how many bytes it has. chances: of contexts, of unary digits, of bits. rows
    (2, W): work memory. ends: as in ``_write``.
    """
    height, width = codes.shape
    begun, further, bits = chances
    above, values = rows
    for row in range(height):
        left, left_above = 0, 0
        for column in range(width):
            up = above[column] if row else left
            if column == 0:
                left, left_above = up, up
            elif row == 0:
                left_above = left
            right_above = above[column + 1] if row and column + 1 < width else up
            sloped = left + up - left_above
            value = max(min(left, up), min(max(left, up), sloped))  # the middle of three
            error = 0 if codes[row, column] < 0 else codes[row, column] - value
            first, second, third = right_above - up, up - left_above, left_above - left
            context = _clipped(first) * (2 * CLIP + 1) + _clipped(second)
            context = 2 * (context * (2 * CLIP + 1) + _clipped(third))
            _write(error != 0, begun, context, ends, content)
            if error != 0:
                _write(error < 0, begun, context + 1, ends, content)
                around = abs(first) + abs(second) + abs(third)
                _write_size(abs(error) - 1, around, further, bits, ends, content)
            left_above, left = up, value + error
            values[column] = left
        above, values = values, above
    for shift in (24, 16, 8, 0):
        content[ends[2]] = (ends[0] >> shift) & 255
        ends[2] += 1
    return ends[2]
