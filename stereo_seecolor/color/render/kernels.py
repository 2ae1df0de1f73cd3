"""Corrects every pixel, on all cores. 8-bit values are looked up by range bin and value; other pixels are computed.

Compiled without numba's own threads, whose simplest layer must not be entered by two threads at once.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.gains import FINE, FINE_BINS, Gains
from stereo_seecolor.color.render.pixel_kernels import above_noise, code_of, light_of, mixed, nearest_code, roll_off, unclipped
from stereo_seecolor.color.render.tone import NODES, Display
from stereo_seecolor.color.table.bins import LOW_BITS
from stereo_seecolor.color.table.counting import L, U, position_of
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import in_parts

FINE_SHIFT = LOW_BITS - FINE.bit_length() + 1
"""A fine range bin is a position after a shift by this many bits."""
ROW = 3 * 256
"""Entries of a range bin in a look-up table."""
BLOCK = 4096
"""Pixels that are computed together: three channels of them stay in the first cache."""
PART_PIXELS = 65536
"""Fewer are not worth another thread."""


class Shown(NamedTuple):
    """Corrected pixels. image (N, 3): encoded for display, 0 where the range is unknown. unknown (N,).
    unrecoverable (N,): noise limits the gain, or the camera clipped the pixel.
    """

    image: NDArray[Any]
    unknown: NDArray[np.bool_]
    unrecoverable: NDArray[np.bool_]


class LookUpTable(NamedTuple):
    """A look-up table. curve: displayed value of each node of light. rows (1025 * 768,): displayed value of each 8-bit value of
    each channel in each fine range bin. filled (1024,): True for bins whose rows have been computed.
    """

    curve: NDArray[Any]
    rows: NDArray[Any]
    filled: NDArray[np.bool_]


def apply(image: NDArray[Any], bits: NDArray[np.int32], gains: Gains, shown: Display) -> tuple[Shown, float]:
    """Correct (N, 3) pixels at (N,) ranges, given as float32 bits.

    Returns the corrected pixels, and the fraction of the pixels of known range with a channel at full scale.
    """
    out = Shown(np.empty_like(image), np.empty(bits.size, np.bool_), np.empty(bits.size, np.bool_))
    looked_up = image.dtype == np.uint8 and not gains.matrix.size
    numbers: list[tuple[int, int]] = []

    def part(a: int, b: int) -> None:
        here = Shown(out.image[a:b], out.unknown[a:b], out.unrecoverable[a:b])
        numbers.append(_correct(image[a:b], bits[a:b], gains, shown, looked_up, here))

    in_parts(part, bits.size, PART_PIXELS)
    clipped, known = map(sum, zip(*numbers, strict=True))
    return out, clipped / max(known, 1)


def linear(image: NDArray[Any], bits: NDArray[np.int32], gains: Gains, decoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 3) float32 linear light, neither clipped nor encoded; 0 where unknown."""
    out = np.empty(image.shape, np.float32)
    in_parts(lambda a, b: _linear(image[a:b], bits[a:b], gains, decoded, out[a:b]), bits.size, PART_PIXELS)
    return out


def code_table(gains: Gains, shown: Display) -> NDArray[np.uint16]:
    """(1025 * 768,) code of each 8-bit value of each channel in each fine range bin; the last bin, of unknown range, is black."""
    table: LookUpTable = _new_table(shown.codes)
    _tabulate((0, FINE_BINS - 1), gains, shown.decoded, table)
    return table.rows


@compiled
def _new_table(curve: Any) -> Any:
    """A look-up table with only the row of unknown range, which is black. Rows take memory when they are written."""
    rows = np.empty((FINE_BINS + 1) * ROW, curve.dtype)
    rows[FINE_BINS * ROW :] = curve[0] if curve.size else 0
    return LookUpTable(curve, rows, np.zeros(FINE_BINS, np.bool_))


@compiled
def _tabulate(span: Any, gains: Any, decoded: Any, table: Any) -> None:
    """Compute the missing rows of the fine range bins from the first to the last of ``span``."""
    last, nodes = np.float32(table.curve.size - 1), np.empty(256, np.int32)
    for fine in range(span[0], span[1] + 1):
        for c in range(0 if table.filled[fine] else 3):
            gain, offset, noise = gains.gain[c, fine], gains.offset[c, fine], gains.noise[fine]
            for value in range(256):
                light = above_noise(gain * decoded[value] - offset, noise)
                nodes[value] = np.int32(min(light * np.float32(NODES) + np.float32(0.5), last))
            for value in range(256):
                table.rows[fine * ROW + c * 256 + value] = table.curve[nodes[value]]
        table.filled[fine] = True


@compiled
def _correct(image: Any, bits: Any, gains: Any, shown: Any, looked_up: bool, out: Any) -> Any:
    """Correct pixels into ``out``, block by block. Returns the numbers of pixels with a channel at full scale, and of known range.

    looked_up: most pixels are looked up, in a table of displayed values, or of codes where highlights roll off.
    """
    fine, places, clipped = np.empty(BLOCK, np.uint32), np.empty(BLOCK, np.uint32), 0
    known = bits.size
    full, near, first_capped = (1 << 8 * image.itemsize) - 1, _first_below_one(shown.known), _first_true(gains.capped)
    codes, factors = np.empty(3 * BLOCK, np.uint16), np.empty(BLOCK, np.float32)
    table = _new_table(shown.values if shown.values.size else shown.codes)
    out.unrecoverable[:] = False
    first, last = FINE_BINS, -1
    for start in range(0, bits.size, BLOCK):
        end = min(start + BLOCK, bits.size)
        pixels, bins = image[start:end], fine[: end - start]
        here = Shown(out.image[start:end], out.unknown[start:end], out.unrecoverable[start:end])
        _fine_bins(bits[start:end], bins, here.unknown)
        nearest, farthest = _span(bins)
        known -= _number_true(here.unknown)
        if not looked_up:
            here.image[:] = 0
        else:
            if nearest < first or farthest > last:  # the table grows with the ranges met
                first, last = min(nearest, first), max(farthest, last)
                _tabulate((first, last), gains, shown.decoded, table)
        if looked_up and shown.values.size:
            _look_up(pixels.reshape(-1), bins, table.rows, here.image.reshape(-1))
        elif looked_up:
            _look_up(pixels.reshape(-1), bins, table.rows, codes)
            _display(codes, factors, shown.shoulder, here.image.reshape(-1))
        highest = _highest(pixels.reshape(-1))
        if not looked_up or highest >= near or farthest >= first_capped:
            number = _chosen(pixels, bins, gains.capped, (near if looked_up else 0, highest), places)
            _compute(pixels, bins, places[:number], gains, (shown, near), here)
        if _highest(here.image.reshape(-1)) == full:
            clipped += _count_full(here.image, full)
    return clipped, known


@compiled
def _fine_bins(bits: Any, fine: Any, unknown: Any) -> None:
    """Write the fine range bins of ranges given as float32 bits; FINE_BINS where the range is unknown."""
    for i in range(bits.size):
        fine[i] = position_of(bits[i]) >> U(FINE_SHIFT)
        unknown[i] = fine[i] == U(FINE_BINS)


@compiled
def _look_up(image: Any, fine: Any, table: Any, codes: Any) -> None:
    """Look up the codes (N * 3,) of 8-bit values."""
    at = L(0)
    for i in range(fine.size):
        row = L(fine[i]) * L(ROW)
        codes[at] = table[row + L(image[at])]
        codes[at + L(1)] = table[row + L(256) + L(image[at + L(1)])]
        codes[at + L(2)] = table[row + L(512) + L(image[at + L(2)])]
        at += L(3)


@compiled
def _display(codes: Any, factors: Any, shoulder: Any, out: Any) -> None:
    """Roll off the highlights of codes (N * 3,) and write displayed values; separate loops, which the compiler vectorizes."""
    knee, length, bend, unit, zero = shoulder
    top = np.float32((1 << 8 * out.itemsize) - 1)
    for i in range(out.size // 3):
        most = np.float32(max(codes[3 * i], max(codes[3 * i + 1], codes[3 * i + 2])))
        factors[i] = roll_off(most, knee, length, bend) * unit
    for i in range(out.size // 3):
        for c in range(3):
            out[3 * i + c] = np.int32(min(max(np.float32(codes[3 * i + c]) * factors[i] - zero, np.float32(0)), top))


@compiled
def _span(fine: Any) -> Any:
    """The lowest and the highest fine range bin of known ranges; lowest > highest where none is known."""
    nearest, farthest = np.uint32(FINE_BINS), np.uint32(0)
    for i in range(fine.size):
        nearest = min(nearest, fine[i])
        farthest = max(farthest, fine[i] * np.uint32(fine[i] != np.uint32(FINE_BINS)))
    return np.int64(nearest), np.int64(farthest)


@compiled
def _number_true(flags: Any) -> Any:
    number = 0
    for i in range(flags.size):
        number += flags[i]
    return number


@compiled
def _first_true(flags: Any) -> Any:
    for i in range(flags.size):
        if flags[i]:
            return i
    return flags.size


@compiled
def _highest(values: Any) -> Any:
    highest = values[0]
    for i in range(values.size):
        highest = max(highest, values[i])
    return highest


@compiled
def _count_full(values: Any, full: int) -> Any:
    number = 0
    for i in range(values.shape[0]):
        number += max(values[i, 0], max(values[i, 1], values[i, 2])) == full
    return number


@compiled
def _chosen(image: Any, fine: Any, capped: Any, values: Any, places: Any) -> Any:
    """Write the numbers of pixels that must be computed into ``places``, and return how many: those whose gain is limited, or that
    have a value of at least ``values[0]``. values[1]: the highest value in the image.
    """
    number, (near, highest) = L(0), values
    if highest < near:
        for i in range(fine.size):
            places[number] = i
            number += L(capped[L(fine[i])])
        return number
    for i in range(fine.size):
        places[number] = i
        special = capped[fine[i]] or max(image[i, 0], max(image[i, 1], image[i, 2])) >= near
        number += L(special and fine[i] != U(FINE_BINS))
    return number


@compiled
def _first_below_one(known: Any) -> Any:
    for value in range(known.size):
        if known[value] < 1:
            return value
    return known.size


@compiled
def _compute(image: Any, fine: Any, places: Any, gains: Any, display: Any, out: Any) -> None:
    """Compute pixels without look-up: of 16 bits, with mixed channels, and where noise limits a gain or the camera clipped.

    display: how light is displayed, and the value from which a channel is nearly clipped.
    """
    shown, near = display
    codes, factors = np.empty((places.size, 3), np.float32), np.empty(places.size, np.float32)
    values = np.empty((places.size, 3), out.image.dtype)
    for k in range(places.size):
        i = L(places[k])
        pixel, at = (L(image[i, 0]), L(image[i, 1]), L(image[i, 2])), L(fine[i])
        highest = max(pixel[0], max(pixel[1], pixel[2]))
        if highest < near:
            light = unclipped(pixel, at, gains, shown.decoded)
            out.unrecoverable[i] = gains.capped[at]
        else:
            light = light_of(pixel, at, gains, shown)
            out.unrecoverable[i] = gains.capped[at] | (shown.known[highest] <= 0)
        noise, (r, g, b) = gains.noise[at], mixed(light, gains.matrix)
        codes[k, 0], codes[k, 1], codes[k, 2] = above_noise(r, noise), above_noise(g, noise), above_noise(b, noise)
    for k in range(places.size):
        for c in range(3):
            codes[k, c] = code_of(codes[k, c], shown.curve) if image.itemsize > 1 else nearest_code(codes[k, c], shown.curve)
    _display(codes.reshape(-1), factors, shown.shoulder, values.reshape(-1))
    for k in range(places.size):
        i = L(places[k])
        for c in range(3):
            out.image[i, c] = values[k, c]


@compiled
def _linear(image: Any, bits: Any, gains: Any, decoded: Any, out: Any) -> None:
    for i in range(bits.size):
        fine = position_of(bits[i]) >> U(FINE_SHIFT)
        out[i] = 0
        if fine != U(FINE_BINS):
            values = U(image[i, 0]), U(image[i, 1]), U(image[i, 2])
            out[i, 0], out[i, 1], out[i, 2] = mixed(unclipped(values, fine, gains, decoded), gains.matrix)
