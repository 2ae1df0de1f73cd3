"""The white point of a survey from targets of known color in its frames: grays, white cards.

    (I - B(z)) / A(z) = white * reflectance * brightness of the target

Charts at several ranges also test the water: their white is the same only if A and B are right.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import decoded_values
from stereo_seecolor.color.white_point import with_white
from stereo_seecolor.extras.evaluation.charts.camera_matrix import SETTINGS as MATRIX
from stereo_seecolor.extras.evaluation.charts.camera_matrix import SeenPatches
from stereo_seecolor.extras.evaluation.charts.chart_spread import MOST_CLIPPED
from stereo_seecolor.extras.evaluation.charts.chart_types import ChartType
from stereo_seecolor.extras.evaluation.charts.targets import Target
from stereo_seecolor.extras.evaluation.measures import gray_angle_deg
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Array, Image, Map, Water


@dataclass(frozen=True)
class WhiteSettings:
    """Limits for patches and targets that are used."""

    least_pixels: int = 12
    """Least unclipped pixels of known range of a patch: fewer are mostly its border."""
    brightest: float = 0.95
    """Light of full scale beyond which a channel may be clipped."""
    least_reflectance: float = 0.05
    """Darker grays are mostly haze."""
    least_direct: float = 0.2
    """Fraction of a patch's light that is not backscatter, in each channel: below, errors of the
    backscatter are multiplied.
    """
    least_relief: float = 0.1
    """Least difference of the targets' ranges, fraction of their mean, for a trend with range."""
    most_brighter: float = 0.5
    """Fraction of a frame that may be brighter than white or sand: reefs reflect a fifth of what
    white does, and more than that means shade or something else.
    """
    likely: float = 3.0
    """Standard errors by which the white of a supposed card may differ from the fitted one."""


SETTINGS = WhiteSettings()
SPARSE = 4  # pixels between those by which a frame's brightness is judged


@dataclass(frozen=True, eq=False)
class ChartPatch:
    """A patch of a target. light (3,): linear, with the water removed, NaN where too little of the
    patch was seen. haze (3,): the backscatter that was subtracted, divided by attenuation as the
    light. range_m: median.
    """

    light: Array
    haze: Array
    range_m: float
    clipped: bool

    @property
    def white(self) -> Array:
        """(3,) logarithm of the light; NaN where too much was backscatter."""
        clear = (self.light >= SETTINGS.least_direct * (self.light + self.haze)).all()
        return np.log(self.light) if clear else np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class SeenWhite:
    """The white of a target. range_m: median. white (3,): its color, as logarithms of mean 0.
    error: standard error of each. brighter: fraction of the frame that is brighter than a card or a
    spot, with the water removed; NaN of a chart.

    patches: those of a chart, in the order of its type. type: of the chart. None for a card.
    """

    frame: str
    target: str
    range_m: float
    white: Array
    error: float
    patches: tuple[ChartPatch, ...] = ()
    type: ChartType | None = None
    brighter: float = float("nan")


def seen_whites(
    frame: str, targets: Sequence[Target], image: Image, range_m: Map, water: Water
) -> Iterator[SeenWhite]:
    """The white of each target in a frame, if enough shows. image: without the survey's light."""
    light = decoded_values(8 * image.dtype.itemsize, water.input_encoding)
    for target in targets:
        patches = tuple(
            _patch(light, image[patch], range_m[patch], water) for patch in target.patches
        )
        colors, ranges_m = _white_of_grays(patches, target)
        if not colors:
            continue
        middle, scatter = np.median(colors, axis=0), 0.0
        if len(colors) > 1:
            scatter = float(np.std(colors, axis=0, ddof=1).mean()) / np.sqrt(len(colors))
        yield SeenWhite(
            frame=frame,
            target=target.name,
            range_m=float(np.median(ranges_m)),
            white=middle - middle.mean(),
            error=float(np.hypot(scatter, target.error)),
            patches=patches if target.type else (),
            type=target.type,
            brighter=float("nan")
            if target.type
            else _brighter(patches[0], light, image, range_m, water),
        )


def _brighter(
    patch: ChartPatch, decoded: NDArray[np.floating], image: Image, range_m: Map, water: Water
) -> float:
    """The fraction of a frame's pixels that are brighter than a patch, with the water removed."""
    pixels, z_m = image[::SPARSE, ::SPARSE], range_m[::SPARSE, ::SPARSE]
    known = np.isfinite(z_m)
    light = np.stack([decoded[pixels[known][:, c]] for c in range(3)], axis=1)
    z_m = z_m[known].astype(np.float64)
    direct = (light - water.backscatter(z_m)) / water.attenuation(z_m)
    return float(np.mean(direct.mean(axis=1) > patch.light.mean()))


def _white_of_grays(
    patches: Sequence[ChartPatch], target: Target
) -> tuple[list[Array], list[float]]:
    """The color of white (3,), as logarithms of mean 0, by each usable gray patch; ranges."""
    grays = patches[target.type.grays] if target.type else patches
    published = (
        decode_srgb(target.type.srgb[target.type.grays])
        if target.type
        else np.array([target.reflectance] * len(grays))
    )
    colors, ranges_m = [], []
    for gray, color in zip(grays, published, strict=True):
        if color.mean() >= SETTINGS.least_reflectance and np.isfinite(gray.white).all():
            white = gray.white - np.log(color)
            colors.append(white - white.mean())
            ranges_m.append(gray.range_m)
    return colors, ranges_m


def believed(seen: Sequence[SeenWhite], water: Water) -> list[SeenWhite]:
    """The targets found in the frames of a dive that are used: charts; without any, cards whose
    white is within the standard errors of the water's white point.
    """
    charts = [one for one in seen if one.type]
    fitted = np.log(water.white) - np.log(water.white).mean()
    error = np.nan_to_num(
        water.standard_errors.get("white", np.full(3, np.nan)) / water.white, nan=np.inf
    )
    return charts or [
        one
        for one in seen
        if (np.abs(one.white - fitted) <= SETTINGS.likely * np.hypot(error, one.error)).all()
    ]


def doubts_of(one: SeenWhite, water: Water) -> list[str]:
    """What in the frame contradicts a spot that a user gave as white or sand."""
    doubts = []
    if not believed([one], water):
        fitted = np.log(water.white) - np.log(water.white).mean()
        red, green, blue = np.exp(one.white - fitted)
        doubts.append(
            f"beside the white point of the dive its red is {red / green:.2f} and its blue "
            f"{blue / green:.2f} of its green, beyond {SETTINGS.likely:g} standard errors of 1"
        )
    if one.brighter > SETTINGS.most_brighter:
        doubts.append(f"{one.brighter:.0%} of the frame is brighter, with the water removed")
    if not doubts:
        return []
    return [f"{one.frame}: {one.target}: {'; '.join(doubts)}: is this white or sand, out of shade?"]


def _patch(
    decoded: NDArray[np.floating], pixels: NDArray[Any], range_m: NDArray[np.floating], water: Water
) -> ChartPatch:
    """A patch from its (N, 3) pixels at (N,) ranges. decoded: linear light of each value."""
    light = np.stack([decoded[pixels[:, c]] for c in range(3)], axis=1)
    bright = np.asarray((light >= SETTINGS.brightest).any(axis=-1))
    clipped = bool(bright.sum() > MOST_CLIPPED * bright.size)
    good = np.isfinite(range_m) & ~bright
    if clipped or good.sum() < SETTINGS.least_pixels:
        return ChartPatch(np.full(3, np.nan), np.full(3, np.nan), np.nan, clipped)
    z_m = np.median(range_m[good]).astype(np.float64)
    backscatter, attenuation = water.backscatter(z_m), water.attenuation(z_m)
    direct = light[good].mean(axis=0, dtype=np.float64) - backscatter
    return ChartPatch(direct / attenuation, backscatter / attenuation, float(z_m), clipped)


@dataclass(frozen=True, eq=False)
class WhiteTrend:
    """The trend of the white with range. per_m, error (2,): change of the logarithm of red and blue
    over green for every meter; 0 where the water is right. near_m, far_m: ranges of the targets.
    """

    per_m: Array
    error: Array
    near_m: float
    far_m: float


@dataclass(frozen=True, eq=False)
class ChartWhite:
    """The white point of a survey. white (3,): its color, logarithms of mean 0. error (3,):
    standard errors. seen: its targets.
    """

    white: Array
    error: Array
    seen: tuple[SeenWhite, ...]

    def patches_in(self, water: Water) -> tuple[SeenPatches | None, ...]:
        """The patches of each target without ``water`` of this white point; None for a card."""
        return tuple(
            _patches(one.patches, one.type, water) if one.type else None for one in self.seen
        )

    def trend(self) -> WhiteTrend | None:
        """The trend of the targets' white with range; None where they are at one range."""
        z_m = np.array([one.range_m for one in self.seen])
        if len(z_m) < 2 or np.ptp(z_m) < SETTINGS.least_relief * z_m.mean():
            return None
        against_green = np.stack([(one.white - one.white[1])[[0, 2]] for one in self.seen])
        weight = 0.5 / np.array([one.error**2 for one in self.seen])
        from_middle = z_m - np.average(z_m, weights=weight)
        spread = float((weight * from_middle**2).sum())
        per_m = (weight * from_middle) @ against_green / spread
        left = (
            against_green
            - np.average(against_green, axis=0, weights=weight)
            - from_middle[:, None] * per_m
        )
        worse = np.maximum((weight[:, None] * left**2).sum(axis=0) / max(len(z_m) - 2, 1), 1.0)
        return WhiteTrend(per_m, np.sqrt(worse / spread), float(z_m.min()), float(z_m.max()))

    @property
    def residuals_deg(self) -> tuple[float, ...]:
        """The angle between each target's white, without the water, and the survey's, degrees."""
        return tuple(float(gray_angle_deg(np.exp(one.white - self.white))) for one in self.seen)

    def set_in(self, water: Water) -> Water:
        """The water with this white point (``with_white``). Its standard errors are those of colors
        at the water's typical range: they include those of the attenuation over the difference of
        that range and the targets'.
        """
        rate = np.nan_to_num(water.standard_errors.get("y", np.zeros(3)))
        range_m = float(np.median([one.range_m for one in self.seen]))
        error = np.hypot(self.error, abs(range_m - (water.typical_range_m or 0.0)) * rate)
        return with_white(water, np.exp(self.white), error)


def _patches(patches: Sequence[ChartPatch], type: ChartType, water: Water) -> SeenPatches | None:
    """Patches of a chart relative to its brightness by its grays; None without usable grays."""
    light = np.stack([patch.light for patch in patches]) / water.white
    haze = np.stack([patch.haze for patch in patches]) / water.white
    published = decode_srgb(type.srgb)
    grays = np.zeros(len(light), bool)
    grays[type.grays] = True
    grays &= np.isfinite(light).all(axis=1) & (published.mean(axis=1) >= SETTINGS.least_reflectance)
    if not grays.any():
        return None
    brightness = float((light[grays] * published[grays]).sum() / (published[grays] ** 2).sum())
    haze /= brightness
    error = MATRIX.backscatter_error * haze.mean(axis=1)
    error = np.hypot(
        error, np.maximum(MATRIX.print_error * published.max(axis=1), MATRIX.least_error)
    )
    clipped = sum(patch.clipped for patch in patches)
    return SeenPatches(type, light / brightness, error, np.nanmean(haze, axis=0), clipped)


def survey_white(seen: Sequence[SeenWhite]) -> ChartWhite:
    """The weighted mean of the white of one target or more; its error from their differences, at
    least from their own errors.
    """
    weights = np.array([one.error**-2 for one in seen])
    colors = np.stack([one.white for one in seen])
    white = np.average(colors, axis=0, weights=weights)
    own = np.sqrt(1 / weights.sum())
    between = np.sqrt(
        np.average((colors - white) ** 2, axis=0, weights=weights) / max(len(seen) - 1, 1)
    )
    return ChartWhite(white, np.maximum(between, own), tuple(seen))
