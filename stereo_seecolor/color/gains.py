"""The gain and offset that take a water out, by channel and range; the exposure; how far noise lets a gain go."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.encoding import decode, decoded_bins, encode
from stereo_seecolor.color.tables import LEVELS, MomentTable, level_edges_m
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.data import Water

MID_GRAY = 0.18
"""Linear light of a surface in the middle of the grays."""

FINE = 4
FINE_LEVELS = FINE * LEVELS
"""Levels of gain: 128 an octave, steps of 0.4 to 0.8 % in range, too fine to be seen as bands."""

BRIGHTEST_SHOWN = 0.97
"""Of full scale, as displayed: where the brightest pixel that may not clip comes to lie; a white card's noise needs the rest."""


@dataclass(frozen=True, eq=False)
class Gains:
    """J = gain I - offset for each channel and fine level of range; capped: where noise allowed no more gain.

    gain, offset: (3, 1024) float32, of full scale. capped: (1024,) bool.
    """

    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    capped: NDArray[np.bool_]


def fine_ranges_m() -> NDArray[np.float64]:
    """(1024,) the middle of each fine level, metres: 128 an octave from 1/8 m to 32 m."""
    edges = level_edges_m()
    steps = (np.arange(FINE) + 0.5) / FINE
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel())


def gains(water: Water, config: ColorConfig, exposure: float) -> Gains:
    """What takes this water out and shows the scene at this exposure."""
    gain, offset = _unexposed(water)
    most = config.output_noise / exposure / _noise(water, config, exposure)
    share = np.minimum(1.0, most / gain)  # of the gain that is wanted
    gain, offset = gain * share * exposure, offset * share * exposure
    return Gains(gain.astype(np.float32), offset.astype(np.float32), np.any(share < 1, axis=0))


def clipping_exposure(table: MomentTable, water: Water, config: ColorConfig) -> float:
    """The exposure at which at most ``config.clipped_share`` of the pixels have a channel at full scale; 1 for a black image."""
    from stereo_seecolor.color import kernels

    gain, offset = _unexposed(water)
    occupied = np.flatnonzero(table.pixels)
    middle = occupied * FINE + FINE // 2
    light = decoded_bins(table.bit_depth, config.input_encoding)
    allowed = int(config.clipped_share * table.pixels.sum())
    counts = np.ascontiguousarray(table.counts[:, occupied])
    brightest = float(kernels.brightest(counts, light, gain[:, middle], offset[:, middle], allowed))
    limit = float(decode(np.array(BRIGHTEST_SHOWN), "as-is" if config.input_encoding == "as-is" else "srgb"))
    return limit / brightest if brightest > 0 else 1.0


def _unexposed(water: Water) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gain and offset (3, 1024) at exposure 1, with no cap but against overflow."""
    z = fine_ranges_m()
    gain = 1.0 / np.maximum(water.attenuation(z) * water.white, 1e-9).T
    return gain, gain * water.backscatter(z).T


def _noise(water: Water, config: ColorConfig, exposure: float) -> NDArray[np.float64]:
    """(3, 1024) noise in linear light of a surface that comes out mid-gray: the config's, times the slope of the decoding there."""
    z = fine_ranges_m()
    light = water.backscatter(z) + water.attenuation(z) * water.white * (MID_GRAY / exposure)
    value, step = encode(np.clip(light, 0, 1), config.input_encoding).T, 0.5 * config.input_noise
    if config.input_encoding == "linear":  # encode() is for the output, and linear input has one slope everywhere
        return np.full(value.shape, config.input_noise)
    slope = (decode(value + step, config.input_encoding) - decode(value - step, config.input_encoding)) / (2 * step)
    return np.asarray(slope * config.input_noise)
