"""Gain and offset that remove the water, by channel and range; noise of the camera and the error of
the backscatter limit the gain.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import decoding_slope
from stereo_seecolor.color.table.range_bins import RANGE_BINS, range_edges_m
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water

MID_GRAY = 0.18
"""Linear light of a surface in the middle of the grays."""

INPUT_NOISE = 0.006
"""Standard deviation of the noise of a pixel, fraction of full scale: 1.5 of 255; for linear images
as if they were encoded in sRGB.
"""
BACKSCATTER_ERROR = 0.05
"""Standard error of the backscatter, relative: it is the same in all directions only in the model.
In FLSea (real), open water varies over an image by 6 to 13 %, its color by 2 to
6 %. As noise of black it makes strong colors in measured waters 0.5 degrees worse.
"""
OUTPUT_NOISE = 0.06
"""Largest error of a channel, fraction of full scale in linear light, which limits its gain: a
third of mid-gray, the limit of detection.
"""
FINE = 4
FINE_BINS = FINE * RANGE_BINS
"""Bins of gain: 128 per octave, steps of 0.4 to 0.8 % in range, too fine for visible bands."""


class Gains(NamedTuple):
    """J = gain I - offset, for each channel and fine range bin.

    gain, offset: (3, 1024) float32, offset as a fraction of full scale. capped: (1025,) bool, True
    where a gain is limited; the last bin is for unknown range: False. missing: (3, 1024) float32,
    fraction of the light of a channel that its limit removes, relative to the channel with the
    least limit. noise: (1024,) float32, of the light of a black surface, root mean square of the
    channels, above the noise from exposure alone. matrix: (3, 3) float32, mixes the channels of J;
    without rows if they are not mixed.
    """

    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    missing: NDArray[np.float32]
    capped: NDArray[np.bool_]
    noise: NDArray[np.float32]
    matrix: NDArray[np.float32]


@cache
def fine_ranges_m() -> NDArray[np.float64]:
    """The (1024,) middle of each fine range bin, meters: 128 per octave from 1/8 m to 32 m."""
    edges = range_edges_m()
    steps = (np.arange(FINE) + 0.5) / FINE
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel())


def gains(water: Water, config: ColorConfig, exposure: float) -> Gains:
    """Compute the gains that remove this water and show the scene at this exposure.

    A channel that is limited more than another is weighted by the square of the ratio of their
    limits, as in Wiener's filter. A color matrix multiplies a channel's noise by at most the
    largest entry of its column.
    """
    wanted, subtracted = unit_exposure_gains(water, fine_ranges_m())
    amplified = np.abs(water.matrix).max(axis=0)[:, None]
    noise = _noise(wanted, subtracted, config, MID_GRAY / exposure)
    error = np.hypot(noise, BACKSCATTER_ERROR * subtracted / wanted)
    most = OUTPUT_NOISE / exposure / amplified / error
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


def unit_exposure_gains(
    water: Water, range_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute (3, N) gain and offset of J = gain I - offset at (N,) ranges and exposure 1."""
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
