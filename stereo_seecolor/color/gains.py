"""The gain and offset that take a water out, by channel and range; the exposure; how far noise lets a gain go."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.encoding import decode, decoded_bins
from stereo_seecolor.color.tables import LEVELS, MomentTable, level_edges_m
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.data import Water

FINE = 4
FINE_LEVELS = FINE * LEVELS
"""Levels of gain: 128 an octave, steps of 0.4 to 0.8 % in range, too fine to be seen as bands."""


@dataclass(frozen=True, eq=False)
class Gains:
    """J = gain I - offset for each channel and fine level of range; capped: where noise allowed no more gain.

    gain, offset: (3, 1024) float32, of full scale. capped: (1024,) bool. exposure: what they hold of it.
    """

    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    capped: NDArray[np.bool_]
    exposure: float


def fine_ranges_m() -> NDArray[np.float64]:
    """(1024,) the middle of each fine level, metres: 128 an octave from 1/8 m to 32 m."""
    edges = level_edges_m()
    steps = (np.arange(FINE) + 0.5) / FINE
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel())


def gains(table: MomentTable, water: Water, config: ColorConfig, exposure: float | None = None) -> Gains:
    """What takes this water out of the table's image.

    exposure None: the water's own, or else the one that lets ``config.clipped_share`` of the pixels clip.
    """
    gain, offset = _unexposed(water)
    exposure = water.exposure if exposure is None else exposure
    if exposure is None:
        exposure = _clipping_exposure(table, gain, offset, config)
    most = config.output_noise / exposure / _noise(table, config)[:, None]
    share = np.minimum(1.0, most / gain)  # of the gain that is wanted
    gain, offset = gain * share * exposure, offset * share * exposure
    return Gains(gain.astype(np.float32), offset.astype(np.float32), np.any(share < 1, axis=0), exposure)


def clipping_exposure(table: MomentTable, water: Water, config: ColorConfig) -> float:
    """The exposure at which at most ``config.clipped_share`` of the pixels have a channel at full scale; 1 for a black image."""
    return _clipping_exposure(table, *_unexposed(water), config)


def _clipping_exposure(table: MomentTable, gain: NDArray[np.float64], offset: NDArray[np.float64], config: ColorConfig) -> float:
    from stereo_seecolor.color import kernels

    occupied = np.flatnonzero(table.pixels)
    middle = occupied * FINE + FINE // 2
    light = decoded_bins(table.bit_depth, config.input_encoding)
    allowed = int(config.clipped_share * table.pixels.sum())
    counts = np.ascontiguousarray(table.counts[:, occupied])
    brightest = float(kernels.brightest(counts, light, gain[:, middle], offset[:, middle], allowed))
    full = 2.0**table.bit_depth - 1
    limit = float(decode(np.array((full - 0.6) / full), "as-is" if config.input_encoding == "as-is" else "srgb"))
    return limit / brightest if brightest > 0 else 1.0


def _unexposed(water: Water) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gain and offset (3, 1024) at exposure 1, with no cap but against overflow."""
    z = fine_ranges_m()
    gain = 1.0 / np.maximum(water.attenuation(z) * water.white, 1e-9).T
    return gain, gain * water.backscatter(z).T


def _noise(table: MomentTable, config: ColorConfig) -> NDArray[np.float64]:
    """(3,) noise of a channel in linear light: the config's, times the slope of the decoding at the channel's mean value."""
    total = max(int(table.pixels.sum()), 1)
    mean = table.counts.sum(axis=1) @ table.values / total
    step = 0.5 * config.input_noise
    slope = (decode(mean + step, config.input_encoding) - decode(mean - step, config.input_encoding)) / (2 * step)
    return np.asarray(slope * config.input_noise)
