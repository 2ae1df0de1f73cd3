"""Chooses the brightness of corrected images from their moment table."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.display import BRIGHTEST_LIGHT, BRIGHTEST_SHOWN, REACH, Tone
from stereo_seecolor.color.render.water_gains import FINE, fine_ranges_m, unit_exposure_gains
from stereo_seecolor.color.table.encoding import decoded_bins
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.records import Water

CLIPPED_FRACTION = 0.0005
"""Largest fraction of pixels that may clip: a distant white card can cover only 0.1 % of a frame.
"""
BRIGHT_PART = 0.05
"""Fraction of the pixels brighter than sand in shade: sand and pale rock, which differ less between
scenes than the median.
"""
BRIGHT_BY_MEDIAN = 2.5
"""Ratio of their light to that of the median, in a scene that is shown at
``config.median_luminance``. Halves of a real dive have 2.4 and 2.8.
"""
MOST_LIGHTER = 1.2
"""Largest factor by which the median is shown lighter or darker, so that bright parts agree."""
STRAYS = 0.02
"""Largest fraction of the pixels, those with the largest gain, that is left out of the choice,"""
STRAY_GAIN = 8.0
"""if the gain of the clearest channel exceeds the median's by this factor: wrong ranges."""
_MANTISSA_BITS = 16
"""Bits of float32's mantissa that are dropped for a histogram of 128 bins an octave."""
_OCTAVES = int(np.float32(np.inf).view(np.int32)) >> _MANTISSA_BITS
"""Bins of such a histogram, up to all finite light."""


def choose(table: MomentTable, water: Water, config: ColorConfig) -> Tone:
    """Choose the tone with a median luminance as near to ``config.median_luminance`` as highlights
    allow.

    The median luminance is that of the medians of the channels: equal if channels are correlated.
    """
    occupied = np.flatnonzero(table.pixels)
    gain, offset = unit_exposure_gains(water, fine_ranges_m()[occupied * FINE + FINE // 2])
    judged = _judged(gain.min(axis=0), table.pixels[occupied])
    occupied = occupied[judged]
    gain = np.ascontiguousarray(gain[:, judged])
    offset = np.ascontiguousarray(offset[:, judged])
    light = decoded_bins(table.bit_depth, config.encoding)
    number = _add_up(table.counts, occupied, gain, offset, light)
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
    above = np.searchsorted(np.cumsum(number[places]), allowed, side="right")
    reached = np.append(places, 0)[above]
    light = ((reached + 1).astype(np.int32) << _MANTISSA_BITS).view(np.float32)
    return float(light) if reached else 0.0


def _add_up(
    counts: NDArray[np.integer],
    bins: NDArray[np.int64],
    gain: NDArray[np.float64],
    offset: NDArray[np.float64],
    light: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Counts (3, 256, V) of range ``bins`` (N,) at the leading bits (exponent and 7 more) of the
    light that they are shown as: (3, 32640). gain, offset: (3, N).
    """
    number = np.zeros((3, _OCTAVES), np.int64)
    for c in range(3):
        for i, range_bin in enumerate(bins):
            shown = np.maximum(gain[c, i] * light - offset[c, i], 0.0).astype(np.float32)
            np.add.at(number[c], shown.view(np.int32) >> _MANTISSA_BITS, counts[c, range_bin])
    return number
