"""The prior of the light of lamps on the rig: mean and covariance of many random rigs.

Lamps near the camera make a pattern that changes with range, and their light falls off. The two are
correlated: a pattern that changes like that of lamps determines the fall-off, which views alone
hardly distinguish from frames with less light.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.water_prior import low_discrepancy
from stereo_seecolor.color.photometry.light_model import PATTERN, SHAPE, TERMS, pattern_terms

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
    """Power of the cosine of the angle from a lamp's axis: half the light at 75 and 27 degrees."""
    aim_rad: float = 0.3
    """Standard deviation of the axis of a lamp relative to that of the camera, each way."""
    attenuation: tuple[float, float] = (0.05, 0.5)
    """Attenuation of luminance, 1/m: clear ocean to harbor; light crosses the water twice."""
    alone: float = 0.3
    """Fraction of rigs with one lamp."""
    half_width: tuple[float, float] = (0.4, 0.9)
    """Tangent of half the horizontal field of view: 44 to 84 degrees."""
    sun: tuple[float, float] = (0.0, 0.6)
    """Fraction of sunlight at the reference range: 0 at night."""
    rest: float = 0.05
    """Standard deviation of a coefficient, for variations that the random rigs do not contain."""
    rest_trend: float = 0.04
    """The same for the trend, for a range that is a fifth longer."""


SETTINGS = LampSettings()
CORNER = (0.4, 1.0)
"""Fraction of light in the corners of a lens; ends of a uniform distribution."""
SIZE = (400, 300)
"""Width and height of the computed images: only their ratio matters."""
_GRID = 9
_STEPS = np.linspace(-2, 2, 5)
"""Computed ranges, in steps of the polynomial: 0.67 to 1.5 times the reference."""


@lru_cache(maxsize=4)
def lamp_ensemble(reference_m: float) -> tuple[Array, Array]:
    """Mean (TERMS + 1,) and covariance of pattern and trend for rigs with lamps, by night
    and day.

    Args:
        reference_m: The typical range of the images, m.
    """
    y, x = np.mgrid[:_GRID:1.0, :_GRID:1.0] * (np.array(SIZE[::-1])[:, None, None] / _GRID)
    places = np.stack([x.ravel(), y.ravel()], axis=1) + np.array(SIZE) / (2 * _GRID) - 0.5
    pixel, steps = np.tile(places, (len(_STEPS), 1)), np.repeat(_STEPS, len(places))
    terms = np.column_stack([pattern_terms(pixel, steps, SIZE), steps, np.ones_like(steps)])
    range_m = reference_m * np.exp(SHAPE.range_step * steps)
    draws = low_discrepancy(SETTINGS.rigs, 18)
    light = np.stack([_light(draw, pixel, range_m, steps == 0) for draw in draws])
    regular = 1e-6 * len(steps) * np.eye(terms.shape[1])
    found = np.linalg.solve(terms.T @ terms + regular, terms.T @ light.T)[: TERMS + 1].T
    return found.mean(axis=0), np.cov(found.T) + unexplained(SETTINGS.rest, SETTINGS.rest_trend)


def unexplained(coefficient: float, trend: float) -> Array:
    """Covariance (TERMS + 1, TERMS + 1) of independent errors of a model of pattern and trend, by
    standard deviations: of a change with range a fifth of a ``coefficient``.
    """
    ranged = [0.2 * coefficient] * (TERMS - PATTERN)
    return np.diag(np.square([coefficient] * PATTERN + ranged + [trend]))


def _light(draw: Array, pixel: Array, range_m: Array, reference: NDArray[np.bool_]) -> Array:
    """(N,) logarithm of the light that returns to (N, 2) pixels from (N,) ranges.

    draw: (18,) in [0, 1). reference: (N,) True at the range where the sun's fraction is defined.
    """
    tangent, corner = _between(SETTINGS.half_width, draw[0]), _between(CORNER, draw[1])
    attenuation = _between(SETTINGS.attenuation, draw[2])
    one = draw[3] < SETTINGS.alone
    across = (2 * pixel + 1 - np.array(SIZE)) / SIZE[0] * tangent
    ray = np.column_stack([across, np.ones(len(pixel))])
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    turned = [1, 0, 2] if draw[16] < 0.5 else [0, 1, 2]
    lit = np.zeros(len(pixel))
    for side, part in ((-1.0, draw[4:10]), (1.0, draw[10:16])):
        lamp_m = np.array(
            [
                side * SETTINGS.sideways_m * part[0],
                (2 * part[1] - 1) * SETTINGS.up_m,
                (2 * part[2] - 1) * SETTINGS.ahead_m,
            ]
        )
        away = ray * range_m[:, None] - lamp_m[turned]
        distance_m = np.linalg.norm(away, axis=1)
        axis = np.array([*(SETTINGS.aim_rad * np.sqrt(12) * (part[3:5] - 0.5)), 1.0])
        cosine = np.maximum(away @ axis / np.linalg.norm(axis) / distance_m, 0.02)
        beam = (
            cosine ** _between(SETTINGS.beam, part[5])
            / distance_m**2
            * np.exp(-attenuation * distance_m)
        )
        lit += beam * (not (one and side > 0))
    sun = _between(SETTINGS.sun, draw[17])
    lit += lit[reference].mean() * sun / (1 - sun)
    radius = (across**2).sum(axis=1) / (tangent**2 * (1 + (SIZE[1] / SIZE[0]) ** 2))
    return np.asarray(np.log(lit) + np.log(corner) * radius - attenuation * range_m)


def _between(ends: tuple[float, float], fraction: float) -> float:
    return ends[0] + (ends[1] - ends[0]) * fraction
