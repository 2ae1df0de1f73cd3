"""The prior of the pattern of a lens in sunlight: vignetting, which darkens the corners
symmetrically about the axis.

If survey lines overlap only at their borders, a change of light along the dive looks like a slope
of the pattern across the track. A lens has no slopes: without evidence for lamps, the light
explains such a change.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.lamp_prior import CORNER, SIZE
from stereo_seecolor.color.photometry.light_model import (
    PATTERN,
    POWERS,
    TERMS,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LensSettings:
    """Standard deviations, of logarithms."""

    rest: float = 0.03
    """Of a coefficient that is not radial, because ports are mounted nearly centered; of its change
    a fifth.
    """
    gain: float = 0.5
    """Of the gain of a frame: clouds, sun and automatic exposure change it by a stop and more."""


LENS_PRIOR_SETTINGS = LensSettings()


def lens_ensemble(trend: float) -> tuple[Array, Array]:
    """Compute mean (TERMS + 1,) and covariance of the coefficients of pattern and trend, for lenses
    in daylight.

    Args:
        trend: Standard deviation of the trend. The mean pattern is 0, so that a pattern that the
            dive does not determine is uniform.
    """
    radial = np.zeros(TERMS + 1)
    width, height = SIZE
    radial[POWERS.index((2, 0))], radial[POWERS.index((0, 2))] = np.array([width**2, height**2]) / (
        width**2 + height**2
    )
    corner = np.log(np.linspace(*CORNER, 101))
    rest = (
        [LENS_PRIOR_SETTINGS.rest] * PATTERN
        + [0.2 * LENS_PRIOR_SETTINGS.rest] * (TERMS - PATTERN)
        + [trend]
    )
    return np.zeros(TERMS + 1), (corner**2).mean() * np.outer(radial, radial) + np.diag(
        np.square(rest)
    )
