"""Chooses the brightness of a corrected image from its moment table."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.gains import FINE, fine_ranges_m, unexposed
from stereo_seecolor.color.render.tone import BRIGHTEST_LIGHT, BRIGHTEST_SHOWN, Tone
from stereo_seecolor.color.table.encoding import decoded_bins
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water

MEDIAN_SHOWN = 0.12
"""Median of a natural scene over its brightest thousandth, as in the robust fit's prior: darker scenes are shown brighter."""
STRAYS = 0.02
"""At most this fraction of a frame's pixels, those with most gain, is left out of the choice of exposure,"""
STRAY_GAIN = 8.0
"""where the gain of the channel least attenuated is this much above that at the median range: wrong ranges, or mostly noise."""
MOST_LIFT = 4.0
"""Most a scene is brightened, two stops: a cave should still look dark, and noise is brightened, too."""
_MANTISSA_BITS = 16
"""Bits of float32's mantissa that are dropped for a histogram of 128 bins an octave."""
_OCTAVES = int(np.float32(np.inf).view(np.int32)) >> _MANTISSA_BITS
"""Bins of such a histogram, up to all finite light."""


def choose(table: MomentTable, water: Water, config: ColorConfig) -> Tone:
    """The tone at which at most ``config.clipped_fraction`` of the pixels have a channel at full scale; 1 for a black image."""
    occupied = np.flatnonzero(table.pixels)
    gain, offset = unexposed(water, fine_ranges_m()[occupied * FINE + FINE // 2])
    judged = _judged(gain.min(axis=0), table.pixels[occupied])
    occupied, gain, offset = occupied[judged], np.ascontiguousarray(gain[:, judged]), np.ascontiguousarray(offset[:, judged])
    number, light = np.zeros(_OCTAVES, np.int64), decoded_bins(table.bit_depth, config.input_encoding)
    _add_up(table.counts, occupied, gain, offset, light, number)
    pixels = int(table.pixels.sum())
    few_and_half = np.array([int(config.clipped_fraction * pixels), 3 * pixels // 2])
    brightest, median = (float(value) for value in _exceeded(number, few_and_half))
    if brightest <= 0:
        return Tone(1.0)
    full = BRIGHTEST_SHOWN if config.input_encoding == "as-is" else BRIGHTEST_LIGHT
    if config.highlights == "clip" or config.input_encoding == "as-is":
        return Tone(full / brightest)
    lift = min(max(MEDIAN_SHOWN * brightest / max(median, 1e-9), 1.0), MOST_LIFT)
    return Tone(lift * full / brightest, lift)


def _judged(gain: NDArray[np.float64], pixels: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,) True for range bins that count, False for those of stray ranges. gain, pixels: (N,) of each bin."""
    order = np.argsort(-gain)
    part = np.cumsum(pixels[order]) / max(pixels.sum(), 1)
    judged = np.ones(len(gain), np.bool_)
    if len(gain):
        usual = gain[order][np.searchsorted(part, 0.5)]
        judged[order] = (part > STRAYS) | (gain[order] <= STRAY_GAIN * usual)
    return judged


def _exceeded(number: NDArray[np.int64], allowed: NDArray[np.int64]) -> NDArray[np.float64]:
    """(K,) the least light that at most ``allowed`` (K,) of the counted values exceed, to 1/128 of an octave; 0 for any light.

    number: (32640,) values counted, by the leading bits of the light that they are shown as (``_add_up``).
    """
    places = np.flatnonzero(number)[::-1]
    reached = np.append(places, 0)[np.searchsorted(np.cumsum(number[places]), allowed, side="right")]
    edge = ((reached + 1).astype(np.int32) << _MANTISSA_BITS).view(np.float32)
    return np.where(reached > 0, edge, 0.0)


@compiled
def _add_up(counts: Any, bins: Any, gain: Any, offset: Any, light: Any, number: Any) -> None:
    """Adds counts (3, 256, V) of range ``bins`` (N,) to ``number``, each at the leading bits (exponent and 7 more) of the light
    that it is shown as. gain, offset: (3, N)."""
    for c in range(3):
        for i in range(bins.size):
            for value in range(light.size):
                shown = np.float32(max(gain[c, i] * light[value] - offset[c, i], 0.0))
                number[shown.view(np.int32) >> _MANTISSA_BITS] += counts[c, bins[i], value]
