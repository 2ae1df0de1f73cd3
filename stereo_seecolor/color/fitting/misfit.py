"""The misfit of a frame's colors to a water: one fitted to other frames, or the frame's own."""

from dataclasses import dataclass

import numpy as np

from stereo_seecolor.color.fitting.robust import SETTINGS as ROBUST
from stereo_seecolor.color.fitting.robust import begin_content, parameters, trust_in
from stereo_seecolor.color.fitting.robust_solver import NOISE, Data, Prior, cost_at, minimize
from stereo_seecolor.color.fitting.scene_prior import whole_prior
from stereo_seecolor.color.fitting.water_prior import WATER
from stereo_seecolor.color.table.range_quantiles import RangeQuantiles
from stereo_seecolor.config import RobustConfig
from stereo_seecolor.records import Water


@dataclass(frozen=True)
class MisfitSettings:
    """What counts as the same water."""

    tolerance: float = 0.05
    """Standard deviation of the logarithms of a shared water's parameters from frame to frame: what cannot be seen in a color."""
    exposure: float = 2.0
    """Standard deviation of the logarithm of a frame's exposure: it says nothing of the water."""


SETTINGS = MisfitSettings()


def quality(seen: RangeQuantiles, settings: RobustConfig, water: Water | None = None) -> float:
    """The least cost of a frame's quantiles under ``water`` at any exposure; for None, under the water that fits the frame best.

    The cost is half the sum of squared errors in standard deviations, with those of the priors: 0 or above.
    water: of the robust method, or of another with attenuation far away (y) above 0.
    """
    scale = max(float(seen.light[..., -2].max()), ROBUST.least_light)
    light = seen.light / scale
    mean, precision, _ = (part.copy() for part in whole_prior(len(seen.range_m), settings))
    brightest = np.log(light[:, :, -2].mean(axis=1) + NOISE.floor)
    if water is not None:
        mean[:WATER] = parameters(water, scale)
        covariance = np.eye(WATER) * SETTINGS.tolerance**2
        covariance[12:, 12:] += SETTINGS.exposure**2
        precision[:WATER, :WATER] = np.linalg.inv(covariance)
    x = mean.copy()
    x[12:WATER] = brightest if water is None else x[12:WATER] + (brightest - x[12:WATER]).mean()
    begin_content(x, seen.range_m, light)
    data, prior = Data(seen.range_m, light, seen.clipped, trust_in(seen)), Prior(mean, precision)
    x, _ = minimize(x, data, prior, NOISE)
    return cost_at(x, data, prior, NOISE)
