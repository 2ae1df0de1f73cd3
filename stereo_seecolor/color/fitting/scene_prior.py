"""The prior of the robust fit: reflectances, light and water (``water_prior``) combined."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.scene_colors import sea_floor
from stereo_seecolor.color.fitting.water_prior import WATER, Vector, water_prior
from stereo_seecolor.config import RobustConfig

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class ScenePrior:
    """Logarithms of reflectance at the nine quantiles, dark to bright, relative to the brightest.

    Numbers without a source were chosen on synthetic scenes of seeds below 100 (docs/lab/color.md).
    """

    reflectance: tuple[float, ...] = (0.003, 0.005, 0.013, 0.06, 0.12, 0.22, 0.45, 0.75, 1.0)
    """Mean of a channel, as a fraction of that of the brightest thousandth. With 0.009 for the
    darkest, backscatter was too low in every kind of water; with 0.001, too high over sand.
    """
    natural: tuple[float, float, float] = (0.2, 0.0, -0.25)
    """Natural scenes are warm (logarithm relative to green). Coral sand is at 0.16, 0, -0.27; the
    mean of photographs in daylight, ImageNet's sRGB 0.485, 0.456, 0.406, at 0.13, 0, -0.25.
    """
    sea_floor: float = 0.5
    """Fraction of the mean color of the spectra of the sea floor (0.27, 0, -0.41 at the median);
    the rest is ``natural``. With more, synthetic scenes of such spectra are better, and FLSea's
    white targets yellower, by 0.1 to 0.2 degrees.
    """
    natural_fraction: tuple[float, ...] = (1, 1, 1, 1, 1, 1, 0.82, 0.48, 0.12)
    """Fraction of ``natural`` at each quantile of a single image: the brightest are nearly white,
    or reflections. With 0.75, 0.35, 0 FLSea's white targets are better by 0.2 degrees, and
    synthetic reefs, whose brightest material is warm sand, worse by 0.4.
    """
    mixed: float = 0.5
    """Of many frames of a dive, few show a card: the brightest are as likely sand. The fraction is
    so far from that of single images to 1, which spectra of the sea floor have at all quantiles.
    """
    color: tuple[float, ...] = (0.8, 0.7, 0.75, 0.7, 0.42, 0.3, 0.17, 0.15, 0.14)
    """Standard deviation from warm to cool: dark objects have any color, bright ones are closer to
    gray. The correlation of channels is that of the spectra of the sea floor (``scene_colors``).
    """
    alike: float = 0.2
    """Correlation of the colors of neighboring quantiles, and its powers for others: a strongly
    colored scene is so from dark to bright. In 30 photographs 0.8 to 0.95; but then only the
    brightest quantile determines white, and reefs are worse.
    """
    reflectance_all: float = 1.0
    """Standard deviation of a quantile's reflectance, all channels together."""
    brightness: float = 0.5
    """Standard deviation of a range's brightness (light, shade, content), all channels together."""
    mean_brightness: float = 100.0
    """Precision of the mean brightness, which is 0: the overall brightness is exposure."""


SCENE = ScenePrior()


SET_COLOR, SET_BRIGHTNESS = 1e-6, 4.0
"""Variances of the logarithms of a white point that the user sets: of its channels, so that the
covariance stays invertible; of its brightness a factor of 7, because exposure is free.
"""


@lru_cache(maxsize=64)
def whole_prior(groups: int, settings: RobustConfig) -> tuple[Vector, Matrix, Matrix]:
    """Mean and precision of all parameters; covariance (15, 15) of the water parameters."""
    number = len(SCENE.reflectance)
    size = WATER + 3 * number + groups
    content, brightness = slice(WATER, WATER + 3 * number), slice(WATER + 3 * number, size)
    mean, precision = np.zeros(size), np.zeros((size, size))
    mean[:WATER], water_covariance = _water(settings)
    precision[:WATER, :WATER] = np.linalg.inv(water_covariance)
    mean[content] = (
        np.log(SCENE.reflectance) + _mean_color(settings) * (settings.white_point != "gray")
    ).ravel()
    apart = np.abs(np.subtract.outer(np.arange(number), np.arange(number)))
    colors = np.outer(SCENE.color, SCENE.color) * SCENE.alike**apart
    together = SCENE.reflectance_all**2 * np.eye(number)
    channels = sea_floor().channels + 1 / 3  # brightness varies as warmth does
    precision[content, content] = np.linalg.inv(
        np.kron(channels, colors) + np.kron(np.ones((3, 3)), together)
    )
    precision[brightness, brightness] = np.eye(groups) / SCENE.brightness**2 + SCENE.mean_brightness
    return mean, precision, water_covariance


def _mean_color(settings: RobustConfig) -> Matrix:
    """(3, 9) mean logarithms of the channels at each quantile, but for what they have in common."""
    warmer = {"mixed": SCENE.mixed, "sand": 1.0}.get(settings.brightest, 0.0)
    fraction = np.array(SCENE.natural_fraction)
    fraction += warmer * (1 - fraction)
    natural = np.array(SCENE.natural)[:, None] - np.mean(SCENE.natural)
    of_all = SCENE.sea_floor * sea_floor().mean + (1 - SCENE.sea_floor) * natural
    return np.asarray(of_all * fraction)


def deviations(covariance: Matrix) -> Matrix:
    """(5, 3) standard deviations from the covariance (15, 15); of white without its mean."""
    color = np.eye(3) - 1 / 3
    variances = np.diag(covariance).reshape(5, 3).copy()
    variances[4] = np.diag(color @ covariance[12:, 12:] @ color)
    return np.sqrt(variances)


def _water(settings: RobustConfig) -> tuple[Vector, Matrix]:
    """What is known of the water's fifteen parameters, and what the configuration sets of them."""
    mean, covariance = water_prior(settings.daylight_depth_m)
    if settings.fits_white:
        return mean, covariance
    known, white = settings.white_point, slice(12, WATER)
    values = np.log(known) if isinstance(known, tuple) else np.zeros(3)
    observed = covariance[white, white] + SET_COLOR * np.eye(3) + SET_BRIGHTNESS
    gain = covariance[:, white] @ np.linalg.inv(observed)
    off = values - values.mean() - mean[white]
    return mean + gain @ off, covariance - gain @ covariance[white]
