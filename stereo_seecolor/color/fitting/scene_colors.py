"""Colors of the sea floor, and the prior of the robust fit that is made of them.

The colors are what cameras see, without water, of scenes that are mixed from published reflectance
spectra.

``reflectances.csv`` holds the spectra with their sources; cameras are those of the prior of the
water. The result, which the prior of the robust fit reads, is kept in ``scene_colors.json``;
``python -m stereo_seecolor.color.fitting.scene_colors`` makes it anew.
"""

import csv
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.water_prior import (
    WATER,
    WAVELENGTH_NM,
    Vector,
    drawn_camera,
    water_prior,
)
from stereo_seecolor.color.table.range_quantiles import FRACTIONS
from stereo_seecolor.config import RobustConfig
from stereo_seecolor.files.text_documents import load_object

# The prior of the robust fit: reflectances and light, joined with the water (``water_prior``).

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class ScenePrior:
    """Logarithms of reflectance at the nine quantiles, dark to bright, against the brightest.

    Numbers without a source were chosen on synthetic scenes of seeds below 100 (docs/lab/color.md).
    """

    reflectance: tuple[float, ...] = (0.003, 0.005, 0.013, 0.06, 0.12, 0.22, 0.45, 0.75, 1.0)
    """Mean of a channel, as a fraction of the brightest thousandth's. With a darkest of 0.009
    backscatter came out too low in every kind of water; with one of 0.001, too high over sand."""
    natural: tuple[float, float, float] = (0.2, 0.0, -0.25)
    """Natural scenes are warm (logarithm against green). Coral sand is at 0.16, 0, -0.27; the mean
    of photographs in daylight, ImageNet's sRGB 0.485, 0.456, 0.406, at 0.13, 0, -0.25.
    """
    sea_floor: float = 0.25
    """Share of the mean color of the sea floor's spectra (0.27, 0, -0.41 at the median), the rest
    ``natural``. With a half, or all, FLSea's white targets come out yellower, by 0.1 and 0.4
    degrees, and drawn scenes of such spectra better.
    """
    natural_fraction: tuple[float, ...] = (1, 1, 1, 1, 1, 1, 0.9, 0.6, 0.25)
    """Fraction of ``natural`` at each quantile: the brightest are white, or reflections."""
    color: tuple[float, ...] = (0.8, 0.7, 0.75, 0.7, 0.42, 0.3, 0.17, 0.15, 0.14)
    """Standard deviation from warm to cool about that: dark things have any color, bright ones
    less. How channels vary together, and less from green to magenta, is that of the sea floor's
    spectra (``scene_colors``).
    """
    alike: float = 0.2
    """Correlation of the colors of neighboring quantiles, and its powers of those beyond: what is
    strongly colored is so from dark to bright. In 30 photographs 0.8 to 0.95, which takes white
    from the brightest alone and suits reefs less.
    """
    reflectance_all: float = 1.0
    """Standard deviation of a quantile's reflectance, all channels together."""
    brightness: float = 0.5
    """Standard deviation of a range's brightness (light, shade, content), all channels together."""
    mean_brightness: float = 100.0
    """Precision that holds the mean brightness near 0: the overall brightness is exposure."""


SCENE = ScenePrior()


@dataclass(frozen=True)
class SetByUser:
    """Variances of logarithms that the configuration sets."""

    value: float = 1e-6
    """Variance of each value: a thousandth of it; keeps the covariance invertible."""
    white_brightness: float = 4.0
    """Variance of the brightness of a set white point: a factor of 7, as exposure is free."""


SET = SetByUser()


@lru_cache(maxsize=64)
def whole_prior(groups: int, settings: RobustConfig) -> tuple[Vector, Matrix, Matrix]:
    """Mean and precision of all parameters, and (5, 3) the water's ``deviations``."""
    number = len(SCENE.reflectance)
    size = WATER + 3 * number + groups
    content, brightness = slice(WATER, WATER + 3 * number), slice(WATER + 3 * number, size)
    mean, precision = np.zeros(size), np.zeros((size, size))
    mean[:WATER], water_covariance = _water(settings)
    precision[:WATER, :WATER] = np.linalg.inv(water_covariance)
    mean[content] = (
        np.log(SCENE.reflectance) + _mean_color() * (settings.white_point != "gray")
    ).ravel()
    apart = np.abs(np.subtract.outer(np.arange(number), np.arange(number)))
    colors = np.outer(SCENE.color, SCENE.color) * SCENE.alike**apart
    together = SCENE.reflectance_all**2 * np.eye(number)
    channels = sea_floor().channels + 1 / 3  # brightness varies as warmth does
    precision[content, content] = np.linalg.inv(
        np.kron(channels, colors) + np.kron(np.ones((3, 3)), together)
    )
    precision[brightness, brightness] = np.eye(groups) / SCENE.brightness**2 + SCENE.mean_brightness
    return mean, precision, deviations(water_covariance)


def _mean_color() -> Matrix:
    """(3, 9) mean logarithms of the channels at each quantile, but for what they have in common."""
    natural = np.array(SCENE.natural)[:, None] - np.mean(SCENE.natural)
    of_all = SCENE.sea_floor * sea_floor().mean + (1 - SCENE.sea_floor) * natural
    return np.asarray(of_all * np.array(SCENE.natural_fraction))


def deviations(covariance: Matrix) -> Matrix:
    """(5, 3) standard deviations of covariance (15, 15); the white point's without their mean."""
    color = np.eye(3) - 1 / 3
    variances = np.diag(covariance).reshape(5, 3).copy()
    variances[4] = np.diag(color @ covariance[12:, 12:] @ color)
    return np.sqrt(variances)


def _water(settings: RobustConfig) -> tuple[Vector, Matrix]:
    """What is known of the water's fifteen parameters, and what the configuration sets of them."""
    depth_m = 0.0 if settings.white_point == "lamps" else None
    mean, covariance = (part.copy() for part in water_prior(depth_m))
    if not settings.fits_white:
        known = settings.white_point
        white = np.log(known) if isinstance(known, tuple) else np.zeros(3)
        mean, covariance = _set(
            mean, covariance, slice(12, WATER), white - white.mean(), together=SET.white_brightness
        )
    return mean, covariance


def _set(
    mean: Vector, covariance: Matrix, where: slice, values: Vector, together: float
) -> tuple[Vector, Matrix]:
    """The Gaussian after ``where`` was observed. together: variance of a common offset."""
    gain = covariance[:, where] @ np.linalg.inv(
        covariance[where, where] + SET.value * np.eye(3) + together
    )
    return mean + gain @ (values - mean[where]), covariance - gain @ covariance[where]


Array = NDArray[np.float64]
SPECTRA = Path(__file__).with_name("reflectances.csv")
COLORS = Path(__file__).with_name("scene_colors.json")


@dataclass(frozen=True)
class Scenes:
    """How spectra are mixed to scenes."""

    number: int = 1024
    """Twice as many move no mean by a twentieth of its standard deviation."""
    pixels: int = 1024
    """Of a scene: its darkest quantile is the third of them."""
    kinds: int = 8
    """Kinds of things in a scene, 1 to this many, each with a share that may be any (Dirichlet)."""
    pigment: float = 0.2
    """Standard deviation of the logarithm of the power of a reflectance: more or less of the same
    pigment (Beer's law).
    """
    brightness: float = 0.4
    """Standard deviation of the logarithm of a thing's brightness from scene to scene, and of its
    places within one.
    """
    shade: float = 0.5
    """Standard deviation of the logarithm of the light of a place."""


SCENES = Scenes()


@dataclass(frozen=True, eq=False)
class SceneColors:
    """Logarithms of R, G, B less their mean, at the quantiles of ``FRACTIONS`` of the sea floor.

    mean: (3, 9). channels: (3, 3) covariance of the channels at one quantile, the mean over
    quantiles, against the variance along the axis from warm to cool (R up, B down): from green to
    magenta a color varies less. cast: (3, 3) covariance of what all quantiles of a scene have in
    common.
    """

    mean: Array
    channels: Array
    cast: Array


@lru_cache
def sea_floor() -> SceneColors:
    """The kept colors of all spectra."""
    kept = load_object(COLORS)
    return SceneColors(*(np.array(kept[name]) for name in ("mean", "channels", "cast")))


def read_spectra() -> tuple[list[str], list[str], Array]:
    """Kinds, sources, and reflectances (N, 31) at ``WAVELENGTH_NM`` of the table of spectra."""
    head, *rows = csv.reader(
        line for line in SPECTRA.read_text().splitlines() if not line.startswith("#")
    )
    nm = np.array(head[3:], np.float64)
    spectra = [np.interp(WAVELENGTH_NM, nm, np.array(row[3:], np.float64)) for row in rows]
    return [row[0] for row in rows], [row[1] for row in rows], np.array(spectra)


def mixed(without: frozenset[str] = frozenset()) -> SceneColors:
    """The colors of scenes that are mixed from all spectra but those of some sources."""
    kinds, sources, spectra = read_spectra()
    kept = np.array([source not in without for source in sources])
    _, kind_of = np.unique(np.array(kinds)[kept], return_inverse=True)
    rng = np.random.default_rng(1)
    logs = np.array(
        [
            np.log(np.quantile(_scene(spectra[kept], kind_of, rng), FRACTIONS, axis=0).T)
            for _ in range(SCENES.number)
        ]
    )
    colors = logs - logs.mean(axis=1, keepdims=True)
    each = np.mean([np.cov(colors[:, :, p].T) for p in range(FRACTIONS.size)], axis=0)
    warm = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
    return SceneColors(
        colors.mean(axis=0), each / (warm @ each @ warm), np.cov(colors.mean(axis=2).T)
    )


def _scene(spectra: Array, kind_of: NDArray[np.intp], rng: np.random.Generator) -> Array:
    """(pixels, 3) linear light of a scene of some kinds of things, each by one of its spectra;
    white is 1.
    """
    chosen = rng.permutation(kind_of.max() + 1)[: rng.integers(1, SCENES.kinds + 1)]
    things = np.array([rng.choice(np.flatnonzero(kind_of == kind)) for kind in chosen])
    power = np.exp(rng.normal(0, SCENES.pigment, (len(things), 1)))
    colors = spectra[things] ** power @ drawn_camera(rng.random(4)).T
    colors *= np.exp(rng.normal(0, SCENES.brightness, (len(things), 1)))
    of = rng.choice(len(things), SCENES.pixels, p=rng.dirichlet(np.ones(len(things))))
    light = rng.normal(0, np.hypot(SCENES.brightness, SCENES.shade), (SCENES.pixels, 1))
    return np.asarray(colors[of] * np.exp(light))


if __name__ == "__main__":
    made = mixed()
    content = {
        name: np.round(getattr(made, name), 4).tolist() for name in ("mean", "channels", "cast")
    }
    COLORS.write_text(
        json.dumps(
            {
                "made by": "stereo_seecolor.color.fitting.scene_colors of reflectances.csv",
                **content,
            },
            indent=1,
        )
        + "\n"
    )
