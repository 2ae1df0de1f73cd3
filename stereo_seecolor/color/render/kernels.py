"""Correcting every pixel, on all cores: by look-up where a level of range and a value say it all, else computed.

Compiled without numba's own threads, whose simplest layer must not be entered by two threads at once.
"""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.gains import FINE, FINE_LEVELS, Gains
from stereo_seecolor.color.render.tone import Looks
from stereo_seecolor.color.table.bins import LOW_BITS
from stereo_seecolor.color.table.counting import BLOCK, LAST, U, divisions, place_of, span, spread
from stereo_seecolor.color.table.encoding import NODES
from stereo_seecolor.compute.compiled import compiled

ROW = 3 * 256
"""Entries of a level in a ``color_table``."""
_FINE_BITS = LOW_BITS - FINE.bit_length() + 1


def apply(
    image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, looks: Looks
) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], float]:
    """(N * 3,) pixels through gain[c, level] * decoded[value] - offset[c, level], the curve and its shoulder; 0 where unknown.

    Gives the pixels; (N,) unknown; (N,) whose level is capped, or that the camera clipped; the share of the others than the unknown
    that has a channel at full scale.
    """
    out, unknown, beyond = np.empty_like(image), np.empty(bits.size, np.bool_), np.empty(bits.size, np.bool_)
    bounds = _bounds(bits.size)
    clipped, known = np.zeros(len(bounds), np.int64), np.zeros(len(bounds), np.int64)
    model = by_level.gain, by_level.offset, by_level.missing, np.append(by_level.capped, False)
    shown = looks.decoded, looks.known, looks.curve, looks.shoulder

    def part(i: int) -> None:
        a, b = bounds[i]
        pixels = slice(3 * a, 3 * b)
        clipped[i] = _correct(image[pixels], bits[a:b], *model, *shown, out[pixels], unknown[a:b].view(np.uint8), beyond[a:b])
        known[i] = b - a - np.count_nonzero(unknown[a:b])

    spread(part, len(bounds))
    return out, unknown, beyond, float(clipped.sum() / max(known.sum(), 1))


def linear(image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, decoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N * 3,) float32 gain[c, level] * decoded[value] - offset[c, level], neither clipped nor encoded; 0 where unknown."""
    out = np.empty(image.size, np.float32)
    bounds = _bounds(bits.size)

    def part(i: int) -> None:
        a, b = bounds[i]
        _linear(image[3 * a : 3 * b], bits[a:b], by_level.gain, by_level.offset, by_level.missing, decoded, out[3 * a : 3 * b])

    spread(part, len(bounds))
    return out


def color_table(by_level: Gains, looks: Looks) -> NDArray[Any]:
    """(1025 * 768,) what each value of each channel becomes on the curve at each fine level; the last level, unknown, is black."""
    table = np.full((FINE_LEVELS + 1) * ROW, looks.curve[0], looks.curve.dtype)
    _tabulate(by_level.gain, by_level.offset, looks.decoded, looks.curve, 0, FINE_LEVELS, table)
    return table


def _bounds(pixels: int) -> list[tuple[int, int]]:
    parts = divisions(pixels)
    return list(itertools.pairwise(pixels * i // parts // 4 * 4 if i < parts else pixels for i in range(parts + 1)))


@compiled
def _rows(bits, rows, unknown):  # type: ignore[no-untyped-def]
    """Where in a ``color_table`` each pixel's fine level begins; 1 where its range is unknown."""
    shift, last = np.int32(_FINE_BITS), np.int32(LAST)
    for i in range(bits.size):
        place = place_of(bits[i])
        rows[i] = np.uint32(place >> shift) * np.uint32(ROW)
        unknown[i] = np.uint8(place > last)


@compiled
def _correct(  # type: ignore[no-untyped-def]
    image, bits, gain, offset, missing, capped, decoded, known, curve, shoulder, out, unknown, beyond
):
    rows, factors, codes = np.empty(BLOCK, np.uint32), np.empty(BLOCK, np.float32), np.empty(3 * BLOCK, curve.dtype)
    near, lost, first_capped, deep = _first(known < 1), _first(known <= 0), _first(capped), image.itemsize == 2
    clipped, full = 0, (1 << 8 * image.itemsize) - 1
    table, low, high = np.empty(0 if deep else (FINE_LEVELS + 1) * ROW, curve.dtype), FINE_LEVELS, FINE_LEVELS
    table[FINE_LEVELS * ROW :] = curve[0]
    for start in range(0, bits.size, BLOCK):
        end = min(start + BLOCK, bits.size)
        pixels, shown, row = image[3 * start : 3 * end], out[3 * start : 3 * end], rows[: end - start]
        beyond[start:end] = False
        _rows(bits[start:end], row, unknown[start:end])
        nearest, farthest = span(row, np.uint32(FINE_LEVELS * ROW))
        nearest, farthest = nearest // ROW, farthest // ROW
        if not deep and nearest <= farthest and not low <= nearest <= farthest < high:  # the table grows with the ranges met
            low, high = (nearest, nearest) if low == high else (low, high)
            _tabulate(gain, offset, decoded, curve, nearest, low, table)
            _tabulate(gain, offset, decoded, curve, high, farthest + 1, table)
            low, high = min(nearest, low), max(farthest + 1, high)
        if not deep and shoulder.size:
            _look_up(pixels, row, table, codes)
            _roll_off(codes, factors, shoulder, shown)
        elif not deep:
            _look_up_words(pixels, row, table, shown)
        if deep or farthest >= first_capped or _highest(pixels) >= near:
            _compute(
                pixels, row, near, lost, gain, offset, missing, capped, decoded, known, curve, shoulder, shown, beyond[start:end]
            )
        if _highest(shown) == full:
            clipped += _full(shown)
    return clipped


@compiled
def _look_up(image, rows, table, out):  # type: ignore[no-untyped-def]
    at = U(0)
    for i in range(rows.size):  # unsigned indices: numba then leaves out its tests for negative ones
        row = U(rows[i])
        out[at] = table[row + U(image[at])]
        out[at + U(1)] = table[row + U(256) + U(image[at + U(1)])]
        out[at + U(2)] = table[row + U(512) + U(image[at + U(2)])]
        at += U(3)


@compiled
def _look_up_words(image, rows, table, out):  # type: ignore[no-untyped-def]
    """``_look_up`` of bytes, four pixels at a time: the processor stores three words as fast as three bytes."""
    whole, at, word, green, blue = rows.size // 4 * 4, U(0), U(0), U(256), U(512)
    words = out[: 3 * whole].view(np.uint32)
    for i in range(U(0), U(whole), U(4)):
        a, b, c, d = U(rows[i]), U(rows[i + U(1)]), U(rows[i + U(2)]), U(rows[i + U(3)])
        words[word] = _word(image, at, table, a, a + green, a + blue, b)
        words[word + U(1)] = _word(image, at + U(4), table, b + green, b + blue, c, c + green)
        words[word + U(2)] = _word(image, at + U(8), table, c + blue, d, d + green, d + blue)
        at += U(12)
        word += U(3)
    _look_up(image[3 * whole :], rows[whole:], table, out[3 * whole :])


@compiled
def _word(image, at, table, first, second, third, fourth):  # type: ignore[no-untyped-def]
    low = np.uint32(table[first + U(image[at])]) | np.uint32(table[second + U(image[at + U(1)])]) << np.uint32(8)
    high = np.uint32(table[third + U(image[at + U(2)])]) | np.uint32(table[fourth + U(image[at + U(3)])]) << np.uint32(8)
    return low | high << np.uint32(16)


@compiled
def _roll_off(codes, factors, shoulder, out):  # type: ignore[no-untyped-def]
    """8-bit codes as displayed; in two loops, of which the compiler does sixteen pixels at a time."""
    knee, span, bend, unit, zero = shoulder
    for i in range(out.size // 3):
        factors[i] = _factor(np.float32(max(codes[3 * i], max(codes[3 * i + 1], codes[3 * i + 2]))), knee, span, bend) * unit
    for i in range(out.size // 3):
        for c in range(3):
            out[3 * i + c] = np.int32(min(max(np.float32(codes[3 * i + c]) * factors[i] - zero, np.float32(0)), np.float32(255)))


@compiled
def _factor(code, knee, span, bend):  # type: ignore[no-untyped-def]
    """What scales the codes of a pixel whose greatest is ``code``: 1 to the knee, and less above (``tone.looks``)."""
    over = max(code - knee, np.float32(0))
    return (min(code, knee) + over * (span + over * bend) / (span + over)) / code


@compiled
def _compute(  # type: ignore[no-untyped-def]
    image, rows, near, lost, gain, offset, missing, capped, decoded, known, curve, shoulder, out, beyond
):
    """Without a table: all pixels of 16 bits, and of 8 bits those where a channel is not what its look-up says: noise has stopped
    its gain, or the camera clipped it. In loops over one thing, of which the compiler does many pixels at a time."""
    levels, places = rows // np.uint32(ROW), np.empty(rows.size, np.uint32)
    number = _chosen(image, levels, capped, near if _highest(image) >= near else known.size, lost, places, beyond)
    lights, full = np.empty((3, number), np.float32), np.float32((1 << 8 * image.itemsize) - 1)
    for k in range(number):
        place = U(places[k])
        at = U(3) * place
        red, green, blue = U(image[at]), U(image[at + U(1)]), U(image[at + U(2)])
        light = _lights(red, green, blue, U(levels[place]), gain, offset, missing, decoded, known)
        lights[0, k], lights[1, k], lights[2, k] = light
    _encode(lights, curve)
    if shoulder.size:
        _shoulder(lights, shoulder)
    if image.itemsize == 2:
        out[:] = 0
    for c in range(3):
        for k in range(number):
            lights[c, k] = min(max(lights[c, k], np.float32(0)), full)
    for k in range(number):
        at = U(3) * U(places[k])
        out[at], out[at + U(1)], out[at + U(2)] = np.int32(lights[0, k]), np.int32(lights[1, k]), np.int32(lights[2, k])


@compiled
def _chosen(image, levels, capped, near, full, places, beyond):  # type: ignore[no-untyped-def]
    """Into ``places`` the pixels to compute, and how many: those of 16 bits with a range, and of 8 bits those beyond a look-up.

    near, full: the values from which on a pixel may be, and is, one that the camera clipped.
    """
    wanted, none = np.empty(levels.size, np.uint8), np.uint32(FINE_LEVELS)
    for i in range(levels.size):
        wanted[i] = beyond[i] = capped[U(levels[i])]
    if image.itemsize == 2:
        for i in range(levels.size):
            wanted[i] = levels[i] != none
    if near < full:
        for i in range(levels.size):
            most, seen = U(max(image[3 * i], max(image[3 * i + 1], image[3 * i + 2]))), levels[i] != none
            wanted[i] |= seen & (most >= U(near))
            beyond[i] |= seen & (most >= U(full))
    number = U(0)
    for i in range(U(0), U(levels.size), U(1)):  # without a branch, which noise would make hard to foresee
        places[number] = i
        number += U(wanted[i])
    return number


@compiled
def _lights(red, green, blue, level, gain, offset, missing, decoded, known):  # type: ignore[no-untyped-def]
    """A pixel's linear light; a channel that the camera clipped is at least as bright as those that it did not, or as the
    brightest if it clipped all."""
    one, zero = np.float32(1), np.float32(0)
    r, g, b = _unclipped(red, green, blue, level, gain, offset, missing, decoded)
    in_r, in_g, in_b = known[red], known[green], known[blue]
    if min(in_r, in_g, in_b) < one:
        lost = (one - in_r) * (one - in_g) * (one - in_b)
        gray = (in_r * r + in_g * g + in_b * b + lost * max(r, g, b)) / (in_r + in_g + in_b + lost)
        r += (one - in_r) * max(gray - r, zero)
        g += (one - in_g) * max(gray - g, zero)
        b += (one - in_b) * max(gray - b, zero)
    return r, g, b


@compiled
def _unclipped(red, green, blue, level, gain, offset, missing, decoded):  # type: ignore[no-untyped-def]
    """A pixel's linear light; what noise leaves out of a channel comes from those that are surer."""
    one = np.float32(1)
    r = gain[0, level] * decoded[red] - offset[0, level]
    g = gain[1, level] * decoded[green] - offset[1, level]
    b = gain[2, level] * decoded[blue] - offset[2, level]
    no_r, no_g, no_b = missing[0, level], missing[1, level], missing[2, level]
    if no_r + no_g + no_b > np.float32(0):
        gray = (r + g + b) / ((one - no_r) + (one - no_g) + (one - no_b))  # r, g, b are what the caps left
        r, g, b = r + no_r * gray, g + no_g * gray, b + no_b * gray
    return r, g, b


@compiled
def _encode(lights, curve):  # type: ignore[no-untyped-def]
    """Linear light (3, N) through the curve, in place: of 8 bits the nearest of its values, of 16 between two."""
    zero, half, last = np.float32(0), np.float32(0.5), np.float32(curve.size - (1 if curve.itemsize < 4 else 2))
    nodes = np.empty(lights.shape[1], np.uint32)
    for c in range(3):
        light = lights[c]
        for k in range(light.size):
            light[k] = max(light[k] * np.float32(NODES), zero)
        if curve.itemsize < 4:
            for k in range(light.size):
                nodes[k] = np.int32(min(light[k] + half, last))
            for k in range(light.size):
                light[k] = curve[nodes[k]]
        else:
            for k in range(light.size):
                place = min(light[k], last)
                node = U(np.int32(place))
                light[k] = curve[node] + (curve[node + U(1)] - curve[node]) * (place - np.float32(node))


@compiled
def _shoulder(codes, shoulder):  # type: ignore[no-untyped-def]
    """Codes (3, N) rolled off and as displayed, in place."""
    knee, span, bend, unit, zero = shoulder
    red, green, blue = codes[0], codes[1], codes[2]
    for k in range(red.size):
        factor = _factor(max(red[k], max(green[k], blue[k])), knee, span, bend) * unit
        red[k] = red[k] * factor - zero
        green[k] = green[k] * factor - zero
        blue[k] = blue[k] * factor - zero


@compiled
def _linear(image, bits, gain, offset, missing, decoded, out):  # type: ignore[no-untyped-def]
    for i in range(bits.size):
        level, at = U(place_of(bits[i]) >> np.int32(_FINE_BITS)), U(3 * i)
        r, g, b = np.float32(0), np.float32(0), np.float32(0)
        if level != U(FINE_LEVELS):
            red, green, blue = U(image[at]), U(image[at + U(1)]), U(image[at + U(2)])
            r, g, b = _unclipped(red, green, blue, level, gain, offset, missing, decoded)
        out[at], out[at + U(1)], out[at + U(2)] = r, g, b


@compiled
def _first(true):  # type: ignore[no-untyped-def]
    for i in range(true.size):
        if true[i]:
            return i
    return true.size


@compiled
def _highest(values):  # type: ignore[no-untyped-def]
    highest = values[0]
    for i in range(values.size):
        highest = max(highest, values[i])
    return highest


@compiled
def _full(image):  # type: ignore[no-untyped-def]
    """How many pixels have a channel at full scale."""
    number, full = np.uint32(0), image.dtype.type((1 << 8 * image.itemsize) - 1)
    for i in range(image.size // 3):
        number += np.uint32(max(image[3 * i], max(image[3 * i + 1], image[3 * i + 2])) == full)
    return number


@compiled
def _tabulate(gain, offset, decoded, curve, low, high, table):  # type: ignore[no-untyped-def]
    """The levels from ``low`` to before ``high`` of a ``color_table``."""
    one, last = np.float32(NODES), np.float32(curve.size - 1)
    nearest = np.empty(256, np.int32)
    for level in range(low, high):
        for c in range(3):
            scale, shift = gain[c, level] * one, offset[c, level] * one - np.float32(0.5)
            row = table[(3 * level + c) * 256 : (3 * level + c + 1) * 256]
            for value in range(256):
                nearest[value] = np.int32(min(max(scale * decoded[value] - shift, np.float32(0)), last))
            for value in range(256):
                row[value] = curve[np.uint32(nearest[value])]
