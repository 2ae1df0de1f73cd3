"""The white point of a survey from things of known color in its frames: grays of charts, white cards.

    (I - B(z)) / A(z) = white * reflectance * brightness of the target

Charts at several ranges also check the water: the color of their white is the same only where A and B are right.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import decoded_values
from stereo_seecolor.evaluation.targets import Target
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Image, Map, Water

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WhiteSettings:
    """What of a target counts."""

    least_pixels: int = 12
    """Of a patch, unclipped and of known range: fewer are mostly its border."""
    brightest: float = 0.95
    """Light of full scale beyond which a channel may be clipped."""
    least_reflectance: float = 0.05
    """Darker grays are mostly haze."""
    least_direct: float = 0.2
    """Fraction of a patch's light that is not backscatter, in each channel: below, errors of the backscatter are multiplied."""
    least_error: float = 0.02
    """Standard error of the color of one target's white, logarithm: print, tilt, and light from the side."""


SETTINGS = WhiteSettings()


@dataclass(frozen=True, eq=False)
class SeenWhite:
    """What a target says. range_m: median. white (3,): the color of its white, as logarithms of mean 0. error: of one of them."""

    frame: str
    target: str
    range_m: float
    white: Array
    error: float


def seen_whites(frame: str, targets: Sequence[Target], image: Image, range_m: Map, water: Water) -> Iterator[SeenWhite]:
    """Of each target in a frame that shows enough: image as the camera saw it, with the survey's light taken out."""
    light = decoded_values(8 * image.dtype.itemsize, water.input_encoding)
    for target in targets:
        patches = target.patches[target.type.grays] if target.type else target.patches
        grays = decode_srgb(target.type.srgb[target.type.grays]).mean(axis=1) if target.type else np.ones(len(patches))
        counted = [patch for patch, gray in zip(patches, grays, strict=True) if gray >= SETTINGS.least_reflectance]
        found = [_patch(light, image[patch], range_m[patch], water) for patch in counted]
        seen = [(white, z_m) for white, z_m in found if np.isfinite(white).all()]
        if seen:
            colors = np.stack([white - white.mean() for white, _ in seen])
            scatter = float(colors.std(axis=0, ddof=1).mean()) / np.sqrt(len(seen)) if len(seen) > 1 else 0.0
            range_of_m = float(np.median([z_m for _, z_m in seen]))
            middle, error = np.median(colors, axis=0), float(np.hypot(scatter, SETTINGS.least_error))
            yield SeenWhite(frame, target.name, range_of_m, middle - middle.mean(), error)


def _patch(decoded: NDArray[np.floating], pixels: NDArray[Any], range_m: NDArray[np.floating], water: Water) -> tuple[Array, float]:
    """Logarithm (3,) of the light at no range, NaN for a patch that does not count; and the patch's range.

    decoded: linear light of each value; pixels: (N, 3) values of the patch's (N,) ranges.
    """
    light = np.stack([decoded[pixels[:, c]] for c in range(3)], axis=1)
    good = np.isfinite(range_m) & (light < SETTINGS.brightest).all(axis=-1)
    if good.sum() < SETTINGS.least_pixels:
        return np.full(3, np.nan), np.nan
    z_m = np.median(range_m[good]).astype(np.float64)
    mean = light[good].mean(axis=0, dtype=np.float64)
    direct = mean - water.backscatter(z_m)
    if (direct < SETTINGS.least_direct * mean).any():
        return np.full(3, np.nan), np.nan
    return np.log(direct) - np.log(water.attenuation(z_m)), float(z_m)


@dataclass(frozen=True, eq=False)
class ChartWhite:
    """white (3,): color of the survey's white point, logarithms of mean 0. error (3,): standard errors. seen: its sources."""

    white: Array
    error: Array
    seen: tuple[SeenWhite, ...]

    @property
    def residuals_deg(self) -> tuple[float, ...]:
        """The angle between each target's white and the survey's: what the water leaves, over the ranges."""
        return tuple(_angle_deg(one.white - self.white) for one in self.seen)

    def set_in(self, water: Water) -> Water:
        """The water with this white point, at its own level; every other number as it was.

        Its standard errors hold what those of the attenuation are from the charts to no range.
        """
        level = np.exp(np.log(water.white).mean())
        white = level * np.exp(self.white)
        rate = np.nan_to_num(water.standard_errors.get("y", np.zeros(3)))
        error = np.hypot(self.error, np.median([one.range_m for one in self.seen]) * rate)
        errors = {**water.standard_errors, "white": white * error}
        return replace(water, white=white, standard_errors=errors, exposure=None, highlights=1.0)


def survey_white(seen: Sequence[SeenWhite]) -> ChartWhite:
    """The weighted mean over one target or more; its error from how they differ, and at least from their own."""
    weights = np.array([one.error**-2 for one in seen])
    colors = np.stack([one.white for one in seen])
    white = np.average(colors, axis=0, weights=weights)
    own = np.sqrt(1 / weights.sum())
    between = np.sqrt(np.average((colors - white) ** 2, axis=0, weights=weights) / max(len(seen) - 1, 1))
    return ChartWhite(white, np.maximum(between, own), tuple(seen))


def _angle_deg(difference: Array) -> float:
    """Between gray and a gray whose channels differ by these logarithms."""
    color = np.exp(difference)
    return float(np.degrees(np.arccos(np.clip(color.sum() / (np.sqrt(3) * np.linalg.norm(color)), -1, 1))))
