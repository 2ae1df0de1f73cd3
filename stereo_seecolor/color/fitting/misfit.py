"""The misfit of a frame's colors to a water: one fitted to other frames, or the frame's own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.robust import begin_content, parameters, scale_of, trust_in
from stereo_seecolor.color.fitting.robust_solver import NOISE, Problem, minimize
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
ENOUGH = 0.1
"""A step that lowers a cost by less ends its minimization: costs are compared with limits of 25 and more."""


def quality(seen: Sequence[RangeQuantiles], settings: RobustConfig, waters: Sequence[Water] | None = None) -> NDArray[np.float64]:
    """(N,) least cost of each frame's quantiles under its water at any exposure; for None, under the water that fits it best.

    The cost is half the sum of squared errors in standard deviations, with those of the priors: 0 or above.
    waters: of the robust method, or of another with attenuation far away (y) above 0.
    """
    if not seen:
        return np.zeros(0)
    each: Sequence[Water | None] = waters or [None] * len(seen)
    begun = [_begin(frame, settings, water) for frame, water in zip(seen, each, strict=True)]
    return minimize([problem for problem, _ in begun], [x for _, x in begun], ENOUGH)[2]


def _begin(seen: RangeQuantiles, settings: RobustConfig, water: Water | None) -> tuple[Problem, NDArray[np.float64]]:
    """What is minimized, and from where."""
    scale = scale_of(seen)
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
    return Problem(seen.range_m, light, seen.clipped, trust_in(seen), mean, precision), x
