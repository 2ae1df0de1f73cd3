"""Priors of the light of a survey: Gaussians of pattern, trend with range, gains and shading."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.lamp_prior import CORNER, SIZE, lamp_ensemble, unexplained
from stereo_seecolor.color.photometry.light_model import PATTERN, POWERS, SHADING, TERMS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deviations:
    """Prior standard deviations of logarithms with mean 0.

    coefficient: of the pattern, of degree 1. ranged: of its change over a fifth of the range.
    trend: with range, for one a fifth longer. gain: of a frame; narrow, so that the pattern
    explains a slope along the track, which looks like a drift of gains. shading: its change from
    the middle of the image to the edge. systematic: of the model itself (lamps are not a
    polynomial): the least error of observations. mean_reef: factor on the standard error of the
    mean of the reef, whose brightness varies more than parts of the image show: with 1, 3.0 % of
    the pattern of nine synthetic dives remain, with 2 2.1 %.
    """

    coefficient: float
    ranged: float
    trend: float
    gain: float
    shading: float
    systematic: float
    mean_reef: float


LUMINANCE = Deviations(
    coefficient=0.5, ranged=0.1, trend=0.4, gain=0.15, shading=0.2, systematic=0.05, mean_reef=2.0
)
"""Corners with half the light and the fall-off of lamps are common; strobes and exposures vary by a
fifth of a stop. Without ``systematic``, gains explained half of the fall-off of lamps by night.
"""
LENS = replace(LUMINANCE, gain=0.5)
"""In sunlight clouds, sun and automatic exposure change a frame by a stop and more."""
LENS_REST = 0.03
"""Standard deviation of a coefficient that is not radial: ports are mounted nearly centered."""
COLOR = Deviations(
    coefficient=0.2, ranged=0.05, trend=0.2, gain=0.06, shading=0.05, systematic=0.0, mean_reef=1.0
)
"""Lamps and lens change color less than brightness. Gains include white balance: with 0.03 and 0.1,
two halves of a real dive differ by 3 and 4 % in their common frame.
"""


def shading_deviations(about: Deviations) -> tuple[float, ...]:
    """(SHADING,) standard deviations of the coefficients of the shading of a frame."""
    return tuple(about.shading / (a + b) for a, b in POWERS[:SHADING])


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A Gaussian: mean (n,), precision (n, n)."""

    mean: Array
    precision: Array

    def misfit(self, unknowns: Array, squares: float, matrix: Array) -> float:
        """Twice the negative log evidence for this prior, up to a constant (MacKay 1992).

        unknowns: (n, Q) at the least sum of ``squares``, in variances. matrix: (n, n) its normal
        equations.
        """
        off = unknowns - self.mean[:, None]
        spread = (
            np.linalg.slogdet(matrix + self.precision)[1] - np.linalg.slogdet(self.precision)[1]
        )
        return float(squares + (off * (self.precision @ off)).sum() + unknowns.shape[1] * spread)


class Alike(NamedTuple):
    """views: number of observations that count as one: neighbors share a caustic and errors of
    range and pose. windows: mean number of windows that show a patch of the reef.
    """

    views: float
    windows: float = 1.0


@dataclass(frozen=True, eq=False)
class LightPrior:
    """mean, covariance: of the TERMS coefficients and the trend. about: gain, shading and model.
    alike: numbers of observations that count as one.
    """

    mean: Array
    covariance: Array
    about: Deviations
    alike: "Alike"

    @classmethod
    def unknown(cls, about: Deviations, alike: "Alike") -> "LightPrior":
        """Make the prior for light of unknown kind: independent coefficients of mean 0, which fall
        with the degree of their terms, as those of the random rigs of ``lamps`` do.
        """
        smooth = 1.0 / np.array([sum(power) for power in POWERS])
        ranged = np.tile(about.ranged * smooth, TERMS // PATTERN - 1)
        each = np.concatenate([about.coefficient * smooth, ranged, [about.trend]])
        return cls(np.zeros(TERMS + 1), np.diag(np.square(each)), about, alike)

    @classmethod
    def lamps(cls, reference_m: float, alike: "Alike") -> "LightPrior":
        """Make the prior of luminance under lamps, with or without daylight, about a range."""
        return cls(*lamp_ensemble(reference_m), LUMINANCE, alike)

    @classmethod
    def lens(cls, alike: "Alike") -> "LightPrior":
        """Make the prior of luminance in sunlight: vignetting, which darkens the corners
        symmetrically about the axis.

        If survey lines overlap only at their borders, a change of light along the dive looks like a
        slope of the pattern across the track. A lens has no slopes: without evidence for lamps, the
        light explains such a change. The mean pattern is 0, so that one that the dive does not
        determine is uniform.
        """
        radial, squares = np.zeros(TERMS + 1), np.square(SIZE)
        radial[[POWERS.index((2, 0)), POWERS.index((0, 2))]] = squares / squares.sum()
        corner = np.log(np.linspace(*CORNER, 101))
        covariance = (corner**2).mean() * np.outer(radial, radial)
        covariance += unexplained(LENS_REST, LENS.trend)
        return cls(np.zeros(TERMS + 1), covariance, LENS, alike)

    def of(self, columns: NDArray[np.bool_], frames: int, of_frame: int) -> Gaussian:
        """The prior of the terms in use (``columns``), and of gain and shading of frames.

        of_frame: number of unknowns of a frame: none, gain, or gain and shading.
        """
        number = int(columns.sum())
        own = np.tile([self.about.gain, *shading_deviations(self.about)][:of_frame], frames)
        mean = np.concatenate([self.mean[columns], np.zeros(own.size)])
        precision = np.diag(np.concatenate([np.ones(number), own**-2.0]))
        precision[:number, :number] = np.linalg.inv(self.covariance[np.ix_(columns, columns)])
        return Gaussian(mean, precision)
