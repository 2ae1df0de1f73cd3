"""Priors of a survey's light: pattern, trend, gains and shading; lamps; lenses in sunlight."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.water_prior import low_discrepancy
from stereo_seecolor.color.photometry.light_model import (
    PATTERN,
    POWERS,
    SHADING,
    SHAPE,
    TERMS,
    pattern_terms,
)

# A prior of the light of lamps on the rig: the light of many random rigs is computed, and its
# mean and covariance taken.
#
# Lamps near the camera make a pattern that changes with range, and their light falls off with the
# square of the range. The two are correlated: a pattern that changes with range like that of
# lamps tells the fall-off, which views of the same spots alone hardly tell from frames that were
# lit less.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LampSettings:
    """The random rigs; pairs are the ends of uniform distributions."""

    rigs: int = 400
    """Number of rigs, nine for each coefficient: the covariance is stable to a few percent."""
    sideways_m: float = 0.8
    """Lamps are up to this far to both sides (or above and below): longer arms are rare."""
    up_m: float = 0.5
    """Distance of lamps from the camera in the direction across, each way."""
    ahead_m: float = 0.3
    """Distance of lamps in front of the camera and behind it."""
    beam: tuple[float, float] = (0.5, 6.0)
    """Power of the cosine from the lamp's axis: half the light at 75 and at 27 degrees."""
    aim_rad: float = 0.3
    """Standard deviation of a lamp's axis against the camera's, each way."""
    attenuation: tuple[float, float] = (0.05, 0.5)
    """Attenuation of luminance, 1/m: clear ocean to harbor. The light passes the water twice."""
    alone: float = 0.3
    """Fraction of rigs with one lamp."""
    half_width: tuple[float, float] = (0.4, 0.9)
    """Tangent of half the horizontal field of view: 44 to 84 degrees."""
    sun: tuple[float, float] = (0.0, 0.6)
    """Fraction of the light at the reference range that is the sun's: none at night."""
    rest: float = 0.05
    """Standard deviation of what is not drawn, of a coefficient; of its change a fifth."""
    rest_trend: float = 0.04
    """Standard deviation of the same in the trend, for a range that is a fifth longer."""


LAMP_PRIOR_SETTINGS = LampSettings()
CORNER = (0.4, 1.0)
"""Light that lenses leave in the corners; ends of an even distribution."""
SIZE = (400, 300)
"""Width and height of the computed images: only their ratio matters."""
_GRID = 9
_STEPS = np.linspace(-2, 2, 5)
"""Ranges that are worked out, in steps of the polynomial: 0.67 to 1.5 times the reference."""


@lru_cache(maxsize=4)
def lamp_ensemble(reference_m: float) -> tuple[Array, Array]:
    """Mean (TERMS + 1,) and covariance of pattern and trend for rigs with lamps, by night and day.

    reference_m: the range that the images are taken from.
    """
    y, x = np.mgrid[:_GRID:1.0, :_GRID:1.0] * (np.array(SIZE[::-1])[:, None, None] / _GRID)
    places = np.stack([x.ravel(), y.ravel()], axis=1) + np.array(SIZE) / (2 * _GRID) - 0.5
    pixel, steps = np.tile(places, (len(_STEPS), 1)), np.repeat(_STEPS, len(places))
    terms = np.column_stack([pattern_terms(pixel, steps, SIZE), steps, np.ones_like(steps)])
    range_m = reference_m * np.exp(SHAPE.range_step * steps)
    draws = low_discrepancy(LAMP_PRIOR_SETTINGS.rigs, 18)
    light = np.stack([_light(draw, pixel, range_m, steps == 0) for draw in draws])
    regular = 1e-6 * len(steps) * np.eye(terms.shape[1])
    found = np.linalg.solve(terms.T @ terms + regular, terms.T @ light.T)[: TERMS + 1].T
    number = TERMS // (SHAPE.range_degree + 1)
    rest = np.array(
        [LAMP_PRIOR_SETTINGS.rest] * number
        + [0.2 * LAMP_PRIOR_SETTINGS.rest] * (TERMS - number)
        + [LAMP_PRIOR_SETTINGS.rest_trend]
    )
    return found.mean(axis=0), np.cov(found.T) + np.diag(rest**2)


def _light(draw: Array, pixel: Array, range_m: Array, reference: NDArray[np.bool_]) -> Array:
    """(N,) logarithm of the light that returns to (N, 2) pixels from (N,) ranges.

    draw: (18,) in [0, 1). reference: (N,) True at the range where the sun's fraction is defined.
    """
    tangent, corner = _between(LAMP_PRIOR_SETTINGS.half_width, draw[0]), _between(CORNER, draw[1])
    attenuation = _between(LAMP_PRIOR_SETTINGS.attenuation, draw[2])
    one = draw[3] < LAMP_PRIOR_SETTINGS.alone
    across = (2 * pixel + 1 - np.array(SIZE)) / SIZE[0] * tangent
    ray = np.column_stack([across, np.ones(len(pixel))])
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    turned = [1, 0, 2] if draw[16] < 0.5 else [0, 1, 2]
    lit = np.zeros(len(pixel))
    for side, part in ((-1.0, draw[4:10]), (1.0, draw[10:16])):
        lamp_m = np.array(
            [
                side * LAMP_PRIOR_SETTINGS.sideways_m * part[0],
                (2 * part[1] - 1) * LAMP_PRIOR_SETTINGS.up_m,
                (2 * part[2] - 1) * LAMP_PRIOR_SETTINGS.ahead_m,
            ]
        )
        away = ray * range_m[:, None] - lamp_m[turned]
        distance_m = np.linalg.norm(away, axis=1)
        axis = np.array([*(LAMP_PRIOR_SETTINGS.aim_rad * np.sqrt(12) * (part[3:5] - 0.5)), 1.0])
        cosine = np.maximum(away @ axis / np.linalg.norm(axis) / distance_m, 0.02)
        beam = (
            cosine ** _between(LAMP_PRIOR_SETTINGS.beam, part[5])
            / distance_m**2
            * np.exp(-attenuation * distance_m)
        )
        lit += beam * (not (one and side > 0))
    sun = _between(LAMP_PRIOR_SETTINGS.sun, draw[17])
    lit += lit[reference].mean() * sun / (1 - sun)
    radius = (across**2).sum(axis=1) / (tangent**2 * (1 + (SIZE[1] / SIZE[0]) ** 2))
    return np.asarray(np.log(lit) + np.log(corner) * radius - attenuation * range_m)


def _between(ends: tuple[float, float], fraction: float) -> float:
    return ends[0] + (ends[1] - ends[0]) * fraction


# A prior of the pattern of a lens in sunlight: vignetting, which darkens the corners
# symmetrically about the axis.
#
# Light that changes along the dive and a slope of the pattern across the track look alike where
# survey lines overlap only by their borders. A lens has no slopes: without evidence for lamps,
# such a change is one of the light.


@dataclass(frozen=True)
class LensSettings:
    """Standard deviations, of logarithms."""

    rest: float = 0.03
    """Of a coefficient that is not radial: ports are mounted nearly centered; of its change a
    fifth.
    """
    gain: float = 0.5
    """Of a frame's gain: clouds, sun and automatic exposure change it by a stop and more."""


LENS_PRIOR_SETTINGS = LensSettings()


def lens_ensemble(trend: float) -> tuple[Array, Array]:
    """Mean (TERMS + 1,) and covariance of the coefficients of pattern and trend, for lenses in
    daylight.

    trend: standard deviation of the trend. The mean is not a pattern, so that a pattern that the
    dive does not determine stays even.
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


# Priors of a survey's light: Gaussians of pattern, trend with range, gains and shading of frames.


@dataclass(frozen=True)
class Deviations:
    """Prior standard deviations of logarithms with mean 0.

    A slope of the pattern along the track and a drift of gains look alike. Gains are held so close
    to 0 that the pattern explains both.
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
    """Standard deviation of the change of shading from the picture's middle to its edge."""
    systematic: float
    """Error of the model itself (the light of lamps is not a polynomial): observations weigh no
    more than with this error against the priors, however well they agree.
    """
    mean_reef: float
    """Factor on the standard error with which the mean of the reef is the same in each part of the
    picture and in each frame. Brightness differs more from place to place than parts of the picture
    show: with 1, 3.0 % of the pattern of nine drawn dives are left, with 2 2.1 %, without it 2.2 %.
    """


LUMINANCE = Deviations(
    coefficient=0.5, ranged=0.1, trend=0.4, gain=0.15, shading=0.2, systematic=0.05, mean_reef=2.0
)
"""Corners at half the light and a fall-off as of lamps are common; strobes and exposures vary by a
fifth of a stop. Without ``systematic`` gains took half of the lamps' fall-off, on a synthetic night
dive whose views agree within 1 %.
"""
COLOR = Deviations(
    coefficient=0.2, ranged=0.05, trend=0.2, gain=0.06, shading=0.05, systematic=0.0, mean_reef=1.0
)
"""Lamps and lens change color less than brightness. A frame's gains differ by its own white
balance; with 0.03 and 0.1, two halves of a real dive that were solved apart differ by 3 and 4 %
where they meet.
"""


def shading_deviations(about: Deviations) -> tuple[float, ...]:
    """(SHADING,) standard deviations of the coefficients of a frame's shading."""
    return tuple(about.shading / (a + b) for a, b in POWERS[:SHADING])


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A Gaussian: mean (n,), precision (n, n)."""

    mean: Array
    precision: Array

    def misfit(self, found: Array, squares: float, matrix: Array) -> float:
        """Twice the negative log evidence for this prior, up to a constant (MacKay 1992).

        found: (n, Q) at the least sum of ``squares``, in variances. matrix: (n, n) its normal
        equations.
        """
        off = found - self.mean[:, None]
        spread = (
            np.linalg.slogdet(matrix + self.precision)[1] - np.linalg.slogdet(self.precision)[1]
        )
        return float(squares + (off * (self.precision @ off)).sum() + found.shape[1] * spread)


class Alike(NamedTuple):
    """views: observations that count as one: neighbors share a caustic and errors of range and
    pose. windows: in which a patch of the reef is found, on average.
    """

    views: float
    windows: float = 1.0


@dataclass(frozen=True, eq=False)
class LightPrior:
    """mean, covariance: of the TERMS coefficients and the trend. about: gain, shading and model.
    alike: how many observations tell the same.
    """

    mean: Array
    covariance: Array
    about: Deviations
    alike: "Alike"

    @classmethod
    def unknown(cls, about: Deviations, alike: "Alike") -> "LightPrior":
        """The prior for light of unknown kind: independent coefficients of mean 0."""
        each = [about.coefficient] * PATTERN + [about.ranged] * (TERMS - PATTERN) + [about.trend]
        return cls(np.zeros(TERMS + 1), np.diag(np.square(each)), about, alike)

    @classmethod
    def lamps(cls, reference_m: float, alike: "Alike") -> "LightPrior":
        """Luminance under lamps on the rig, with or without daylight, about ``reference_m``."""
        return cls(*lamp_ensemble(reference_m), LUMINANCE, alike)

    @classmethod
    def lens(cls, alike: "Alike") -> "LightPrior":
        """Luminance in sunlight, whose strength and exposure change from frame to frame."""
        about = replace(LUMINANCE, gain=LENS_PRIOR_SETTINGS.gain)
        return cls(*lens_ensemble(about.trend), about, alike)

    def of(self, columns: NDArray[np.bool_], frames: int, of_frame: int) -> Gaussian:
        """The prior of the terms in use (``columns``), and of gain and shading of frames.

        of_frame: number of unknowns of a frame: none, its gain, or its gain and its shading.
        """
        number = int(columns.sum())
        own = np.tile([self.about.gain, *shading_deviations(self.about)][:of_frame], frames)
        mean = np.concatenate([self.mean[columns], np.zeros(own.size)])
        precision = np.diag(np.concatenate([np.ones(number), own**-2.0]))
        precision[:number, :number] = np.linalg.inv(self.covariance[np.ix_(columns, columns)])
        return Gaussian(mean, precision)
