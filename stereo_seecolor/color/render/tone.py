"""The brightness of a corrected image, and the roll-off of its highlights."""

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import (
    InputEncoding,
    decoded_bins,
    decoded_values,
    decoding_slope,
    encode,
)
from stereo_seecolor.color.table.moment_table import RANGE_BINS, MomentTable, range_edges_m
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.files import srgb
from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.records import Water

# Gain and offset that remove the water, by channel and range, and the limit that noise sets to the
# gain.

MID_GRAY = 0.18
"""Linear light of a surface in the middle of the grays."""

INPUT_NOISE = 0.006
"""Noise of a pixel as a fraction of full scale, standard deviation: 1.5 of 255; of linear images as
if they were encoded in sRGB.
"""
OUTPUT_NOISE = 0.06
"""Noise, fraction of full scale in linear light, at which a channel's gain stops: a third of
mid-gray, the limit of detection.
"""
FINE = 4
FINE_BINS = FINE * RANGE_BINS
"""Bins of gain: 128 an octave, steps of 0.4 to 0.8 % in range, too fine to be seen as bands."""


class Gains(NamedTuple):
    """J = gain I - offset, for each channel and fine range bin.

    gain, offset: (3, 1024) float32, offset as a fraction of full scale. capped: (1025,) bool, True
    where noise limits a gain; the last is for unknown range: False. missing: (3, 1024) float32,
    fraction of a channel's light that its limit leaves out, relative to the channel that is limited
    least. noise: (1024,) float32, of the light of a black surface, root mean square of the
    channels, above that which exposure alone gives. matrix: (3, 3) float32, mixes the channels of
    J; of no rows where they are not mixed.
    """

    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    missing: NDArray[np.float32]
    capped: NDArray[np.bool_]
    noise: NDArray[np.float32]
    matrix: NDArray[np.float32]


@cache
def fine_ranges_m() -> NDArray[np.float64]:
    """(1024,) middle of each fine range bin, meters: 128 an octave from 1/8 m to 32 m."""
    edges = range_edges_m()
    steps = (np.arange(FINE) + 0.5) / FINE
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel())


def gains(water: Water, config: ColorConfig, exposure: float) -> Gains:
    """The gains that remove this water and show the scene at this exposure.

    A channel that noise limits more than another is weighted by the square of the ratio of their
    limits, as in Wiener's filter. A color matrix multiplies a channel's noise by at most the
    largest entry of its column.
    """
    wanted, subtracted = unexposed(water, fine_ranges_m())
    amplified = np.abs(water.matrix).max(axis=0)[:, None]
    most = (
        OUTPUT_NOISE
        / exposure
        / amplified
        / _noise(wanted, subtracted, config, MID_GRAY / exposure)
    )
    allowed = np.minimum(1.0, most / wanted)
    best = allowed.max(axis=0)
    trust = (allowed / best) ** 2
    shown = best * trust * exposure
    gain, offset, missing = (
        part.astype(np.float32) for part in (wanted * shown, subtracted * shown, 1 - trust)
    )
    matrix = water.matrix.astype(np.float32)[: 0 if (water.matrix == np.eye(3)).all() else 3]
    black = np.square(_noise(wanted, subtracted, config, 0.0) * wanted * shown).mean(axis=0)
    without_water = np.square(INPUT_NOISE * decoding_slope(np.zeros(1), config.encoding) * exposure)
    noise = np.sqrt(np.maximum(black - without_water, 0.0)).astype(np.float32)
    return Gains(gain, offset, missing, np.append((allowed < 1).any(axis=0), False), noise, matrix)


def unexposed(
    water: Water, range_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3, N) gain and offset of J = gain I - offset at (N,) ranges and exposure 1."""
    gain = (
        1.0 / np.maximum(water.attenuation(range_m) * water.white, 1e-9).T * range_m**water.fall_off
    )
    return gain, gain * water.backscatter(range_m).T


def _noise(
    gain: NDArray[np.float64], offset: NDArray[np.float64], config: ColorConfig, surface: float
) -> NDArray[np.float64]:
    """(3, N) noise in linear light, before gains, of a surface of corrected light ``surface``."""
    light = (offset + surface) / gain
    return np.asarray(INPUT_NOISE * decoding_slope(np.minimum(light, 1.0), config.encoding))


# The exposure of an image for display, and the roll-off of highlights beyond full scale.
#
# A scene is shown at one median brightness. Where its brightest would then
# clip, light above mid-gray is compressed: all channels of a pixel by one factor, which depends
# on its brightest channel alone. Chromaticity does not change, and light up to mid-gray stays
# linear.

BRIGHTEST_SHOWN = 0.97
"""Displayed value of the brightest pixel that may not clip: leaves room for a target's noise."""
BRIGHTEST_LIGHT = float(srgb.decode_srgb(np.array(BRIGHTEST_SHOWN)))
"""The same in linear light."""
NODES = 16384
"""Steps of the encoding curve from light 0 to 1: at most a fifth of an 8-bit step."""
REACH = 5
"""Light up to this many times full scale keeps its order before it rolls off. Exposure goes no
further: the bright parts of a picture turn flat and pale, and noise is brightened, too. With 4,
dark corals beside sunlit sand are shown at a median of 0.13 to 0.14.
"""
CODES = {8: 128, 16: 1}
"""Codes a value, by bit depth: 8-bit values are rounded from codes, in 16 bits."""
FULL_FROM, FULL_AT = 0.95, 0.99
"""Encoded: from the second on, a value is only a lower bound of the light; between, in part."""


class Tone(NamedTuple):
    """exposure: gain of all channels. highlights: light of so many times the brightest light shown
    is rolled off to it; 1 = no roll-off.
    """

    exposure: float
    highlights: float = 1.0


class Display(NamedTuple):
    """Tables that convert a camera's values to light, and light to displayed values; V = 256 or
    65536.

    decoded (V,): linear light of a value. known (V,): 1; less for values so high that the camera
    may have clipped them.
    curve (81922,): codes of linear light 0, 1/NODES .. REACH, the last twice. codes (81922,): the
    same rounded, for look-up tables of 8 bits. values (81922,): displayed value of each code; of no
    nodes where highlights roll off. shoulder (5,): knee, length and bend of the roll-off, in codes;
    values per code; the value of code 0, negated, less a half for rounding.
    """

    decoded: NDArray[np.float32]
    known: NDArray[np.float32]
    curve: NDArray[np.float32]
    codes: NDArray[np.uint16]
    values: NDArray[np.uint16]
    shoulder: NDArray[np.float32]


@lru_cache(maxsize=8)
def display(bit_depth: int, encoding: InputEncoding, highlights: float) -> Display:
    """The tables for images of 8 or 16 bits.

    Light up to mid-gray is shown in proportion. Above, the code of a pixel's brightest channel
    follows Reinhard's curve (2002, eq. 4), with slope 1 at mid-gray, which takes ``highlights``
    times the brightest light shown to that light; the other channels keep their ratio to it. Codes
    are sRGB values from the origin of its power law, so that a factor on codes is a factor on light
    (but for the darkest).
    """
    values, each = 2**bit_depth - 1, CODES[bit_depth]
    zero = 0.0 if encoding == "as-is" else srgb.OFFSET
    shoulder = [np.inf, 1.0, 0.0, 1 / each, values * zero - 0.5]
    if highlights > 1:
        light = np.array([MID_GRAY, BRIGHTEST_LIGHT, highlights * BRIGHTEST_LIGHT])
        knee, top, most = values * each * srgb.SCALE * light ** (1 / srgb.POWER)
        shoulder[:3] = knee, top - knee, ((top - knee) / (most - knee)) ** 2
    known = np.clip(
        (FULL_AT - np.arange(values + 1) / values) / (FULL_AT - FULL_FROM), 0, 1
    ).astype(np.float32)
    curve = _code_curve(bit_depth, encoding, zero)
    codes, unit, least = (
        np.round(np.minimum(curve, 65535)).astype(np.uint16),
        *np.array(shoulder[3:], np.float32),
    )
    displayed = np.clip(codes[: 0 if highlights > 1 else codes.size] * unit - least, 0, 255).astype(
        np.uint16
    )
    return Display(
        decoded_values(bit_depth, encoding),
        known,
        curve,
        codes,
        displayed,
        np.array(shoulder, np.float32),
    )


@lru_cache
def _code_curve(bit_depth: int, encoding: InputEncoding, zero: float) -> NDArray[np.float32]:
    codes = (
        (encode(np.linspace(0, REACH, REACH * NODES + 1), encoding) + zero)
        * (2**bit_depth - 1)
        * CODES[bit_depth]
    )
    return np.append(codes, codes[-1]).astype(np.float32)


# Chooses the brightness of corrected images from their moment table.

CLIPPED_FRACTION = 0.0005
"""Of all pixels, those that may clip: a distant white card can cover only 0.1 % of a frame."""
BRIGHT_PART = 0.05
"""Fraction of the pixels that is brighter than sand in shade: sand and pale rock, which differ less
from scene to scene than the median does.
"""
BRIGHT_BY_MEDIAN = 2.5
"""Their light over the median's, in a scene that is shown at ``config.median_luminance``. Halves of
a real dive have 2.4 and 2.8.
"""
MOST_LIGHTER = 1.2
"""Factor by which the median may be shown lighter or darker so that bright parts are alike."""
STRAYS = 0.02
"""At most this fraction of the pixels, those with most gain, is left out of the choice,"""
STRAY_GAIN = 8.0
"""where the least attenuated channel's gain is so much above the median's: wrong ranges."""
_MANTISSA_BITS = 16
"""Bits of float32's mantissa that are dropped for a histogram of 128 bins an octave."""
_OCTAVES = int(np.float32(np.inf).view(np.int32)) >> _MANTISSA_BITS
"""Bins of such a histogram, up to all finite light."""


def choose(table: MomentTable, water: Water, config: ColorConfig) -> Tone:
    """The tone of median luminance about ``config.median_luminance``, as near as highlights allow.

    That is the luminance of the channels' medians: it is where channels rise and fall together.
    """
    occupied = np.flatnonzero(table.pixels)
    gain, offset = unexposed(water, fine_ranges_m()[occupied * FINE + FINE // 2])
    judged = _judged(gain.min(axis=0), table.pixels[occupied])
    occupied = occupied[judged]
    gain = np.ascontiguousarray(gain[:, judged])
    offset = np.ascontiguousarray(offset[:, judged])
    number = np.zeros((3, _OCTAVES), np.int64)
    light = decoded_bins(table.bit_depth, config.encoding)
    _add_up(table.counts, occupied, gain, offset, light, number)
    pixels = int(table.pixels[occupied].sum())
    brightest = _exceeded(number.sum(axis=0), int(CLIPPED_FRACTION * pixels))
    if brightest <= 0:
        return Tone(1.0)
    if config.encoding == "as-is":
        return Tone(BRIGHTEST_SHOWN / brightest)
    median, bright = (
        float(LUMINANCE @ [_exceeded(channel, int(part * pixels)) for channel in number])
        for part in (0.5, BRIGHT_PART)
    )
    unclipped, wanted = BRIGHTEST_LIGHT / brightest, config.median_luminance / max(median, 1e-9)
    lighter = BRIGHT_BY_MEDIAN * median / max(bright, 1e-9)
    wanted *= min(max(lighter, 1 / MOST_LIGHTER), MOST_LIGHTER)
    exposure = min(wanted, unclipped * REACH)
    return Tone(exposure, max(exposure / unclipped, 1.0))


def _judged(gain: NDArray[np.float64], pixels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,) False for range bins of stray ranges. gain, pixels: (N,) of each bin."""
    order = np.argsort(-gain)
    part = np.cumsum(pixels[order]) / max(pixels.sum(), 1)
    judged = np.ones(len(gain), np.bool_)
    if len(gain):
        usual = gain[order][np.searchsorted(part, 0.5)]
        judged[order] = (part > STRAYS) | (gain[order] <= STRAY_GAIN * usual)
    return judged


def _exceeded(number: NDArray[np.int64], allowed: int) -> float:
    """The least light that at most ``allowed`` values exceed, to 1/128 of an octave; 0 for any.

    number: (32640,) values counted by the leading bits of their light (``_add_up``).
    """
    places = np.flatnonzero(number)[::-1]
    reached = np.append(places, 0)[
        np.searchsorted(np.cumsum(number[places]), allowed, side="right")
    ]
    return (
        float(((reached + 1).astype(np.int32) << _MANTISSA_BITS).view(np.float32))
        if reached
        else 0.0
    )


@compiled
def _add_up(counts: Any, bins: Any, gain: Any, offset: Any, light: Any, number: Any) -> None:
    """Adds counts (3, 256, V) of range ``bins`` (N,) to ``number`` (3, 32640), at the leading bits
    (exponent and 7 more) of the light that they are shown as. gain, offset: (3, N).
    """
    for c in range(3):
        for i in range(bins.size):
            for value in range(light.size):
                shown = np.float32(max(gain[c, i] * light[value] - offset[c, i], 0.0))
                number[c, shown.view(np.int32) >> _MANTISSA_BITS] += counts[c, bins[i], value]
