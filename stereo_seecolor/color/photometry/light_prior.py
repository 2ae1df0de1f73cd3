"""Priors of a survey's light: Gaussians of pattern, trend with range, gains and shading of frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry import lens_prior
from stereo_seecolor.color.photometry.lamp_prior import lamp_ensemble
from stereo_seecolor.color.photometry.light_model import PATTERN, POWERS, SHADING, TERMS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deviations:
    """Prior standard deviations of logarithms with mean 0.

    A slope of the pattern along the track and a drift of gains look alike. Gains are held so close to 0 that the pattern explains
    both.
    """

    coefficient: float
    """Standard deviation of a coefficient of the pattern."""
    ranged: float
    """Standard deviation of the change of a coefficient over a fifth of the range."""
    trend: float
    """Standard deviation of the trend with range, for a range that is a fifth longer."""
    gain: float
    """Standard deviation of a frame's gain."""
    shading: float
    """Standard deviation of how a frame's shading changes from the middle of the picture to its edge."""
    systematic: float
    """Error of the model itself (the light of lamps is no polynomial): sightings weigh no more than with this error against the
    priors, however well they agree."""


LUMINANCE = Deviations(coefficient=0.5, ranged=0.1, trend=0.4, gain=0.15, shading=0.2, systematic=0.05)
"""Corners at half the light and a fall-off as of lamps are common; strobes and exposures vary by a fifth of a stop. Without
``systematic`` gains took half of the lamps' fall-off, on a synthetic night dive whose views agree within 1 %."""
COLOR = Deviations(coefficient=0.2, ranged=0.05, trend=0.2, gain=0.03, shading=0.05, systematic=0.0)
"""Lamps and lens change color less than brightness, and a frame's light hardly at all. With 0.5 for gains the frames of a real dive
drifted from pink to green, at the same agreement between views."""


def shading_deviations(about: Deviations) -> tuple[float, ...]:
    """(SHADING,) standard deviations of the coefficients of a frame's shading."""
    return tuple(about.shading / (a + b) for a, b in POWERS[:SHADING])


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A Gaussian: mean (n,), precision (n, n)."""

    mean: Array
    precision: Array

    def misfit(self, found: Array, squares: float, matrix: Array) -> float:
        """Twice the negative logarithm of the evidence for this prior, up to a constant (MacKay 1992).

        found: (n, Q) at the least sum of ``squares``, in variances. matrix: (n, n) its normal equations.
        """
        off = found - self.mean[:, None]
        spread = np.linalg.slogdet(matrix + self.precision)[1] - np.linalg.slogdet(self.precision)[1]
        return float(squares + (off * (self.precision @ off)).sum() + found.shape[1] * spread)


@dataclass(frozen=True, eq=False)
class LightPrior:
    """A prior of the light. mean, covariance: of the TERMS coefficients and the trend. gain, systematic: as in Deviations.

    shading: (SHADING,) standard deviations of the coefficients of a frame's shading.
    alike: number of correlated sightings that count as one measurement against the prior.
    """

    mean: Array
    covariance: Array
    gain: float
    shading: Sequence[float]
    systematic: float
    alike: float

    @classmethod
    def unknown(cls, about: Deviations, alike: float) -> "LightPrior":
        """The prior for light of unknown kind: independent coefficients of mean 0."""
        deviations = [about.coefficient] * PATTERN + [about.ranged] * (TERMS - PATTERN) + [about.trend]
        return cls(
            np.zeros(TERMS + 1), np.diag(np.square(deviations)), about.gain, shading_deviations(about), about.systematic, alike
        )

    @classmethod
    def lamps(cls, reference_m: float, alike: float) -> "LightPrior":
        """The prior of luminance under lamps on the rig, with or without daylight, in pictures taken from about ``reference_m``."""
        return cls(*lamp_ensemble(reference_m), LUMINANCE.gain, shading_deviations(LUMINANCE), LUMINANCE.systematic, alike)

    @classmethod
    def lens(cls, alike: float) -> "LightPrior":
        """The prior of the luminance of pictures in sunlight, whose strength and exposure change from frame to frame."""
        ensemble, gain = lens_prior.lens_ensemble(LUMINANCE.trend), lens_prior.SETTINGS.gain
        return cls(*ensemble, gain, shading_deviations(LUMINANCE), LUMINANCE.systematic, alike)

    def of(self, columns: NDArray[np.bool_], frames: int, of_frame: int) -> Gaussian:
        """The prior of the terms in use (``columns``), and of gain and shading of ``frames`` frames.

        of_frame: number of unknowns of a frame: none, its gain, or its gain and its shading.
        """
        number = int(columns.sum())
        own = np.tile([self.gain, *self.shading][:of_frame], frames)
        mean, precision = np.zeros(number + own.size), np.diag(np.concatenate([np.ones(number), own**-2.0]))
        mean[:number] = self.mean[columns]
        precision[:number, :number] = np.linalg.inv(self.covariance[np.ix_(columns, columns)])
        return Gaussian(mean, precision)
