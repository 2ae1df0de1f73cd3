"""Differences of the same spots between the frames of a run, and trends of color over the image
and over range; needs no truth.

Frames up to four apart are registered by matched features. Spots whose range agrees in both are
compared: means of 5x5 pixels of linear light, uncorrected and corrected.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.robust_statistics import deviation
from calibration.transforms import inverse, transform_points
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.mapping.track.features import Features, detect
from stereo_seecolor.mapping.track.relative_pose import relative_pose
from stereo_seecolor.records import Array, Image, Map, SurveyFrame


@dataclass(frozen=True)
class SpreadSettings:
    """The frames and spots that are compared."""

    apart: int = 4
    """Frames apart at most: beyond, few frames of usual surveys overlap."""
    points: int = 20_000
    """Spots drawn from each frame."""
    window_px: int = 5
    """Side of the square that is averaged: finds the same texture in spite of a pixel's error."""
    agreement: float = 0.02
    """Relative difference of the two ranges of a spot at which it is the same."""
    darkest: float = 0.003
    brightest: float = 0.97
    """Linear light of each channel, of full scale: below is noise, above may be clipped."""
    least: int = 200
    """Spots that both frames of a pair must show for the offset between them to be counted."""
    border: float = 0.1
    """Spots are at the border within this fraction of the image's width or height from it,"""
    center: float = 0.25
    """and at the center farther from it than this."""
    nearest: float = 0.25
    farthest: float = 0.15
    """Of the pixels by range: their red to blue is compared (Jamieson, How and Girdhar 2023, of
    ORCA's dives).
    """
    ranged_points: int = 2000
    """Pixels of each frame for that."""


SETTINGS = SpreadSettings()


@dataclass(frozen=True)
class Spread:
    """Differences between views. luminance: robust standard deviation (1.4826 MAD) of the logarithm
    of the ratio of two views.

    frame_offsets: rms over pairs of frames of its median. angle_deg: median angle between the two
    views' colors. spots: compared.
    border (3,): of spots that one frame shows at the border and another at the center, the median
    logarithm of border over center: luminance, red over green, blue over green. border_error (3,):
    its standard error, from the pairs of frames. NaN without such.
    far_red_to_blue: red over blue of the farthest 15 % of the pixels over that of the nearest 25 %.
    """

    luminance: float
    frame_offsets: float
    angle_deg: float
    spots: int
    border: tuple[float, float, float]
    border_error: tuple[float, float, float]
    far_red_to_blue: float


@dataclass(frozen=True)
class SpreadReport:
    """Differences between views of the raw images, of the run's corrected ones, and of other
    tools', by method.

    pairs: number of pairs of frames that show the same spots.
    """

    raw: Spread
    corrected: Spread
    others: dict[str, Spread]
    pairs: int


@dataclass(frozen=True, eq=False)
class ComparedFrame:
    """A frame of a run. raw: the rectified image before correction. shown: as the map takes it.

    others: method -> the rectified image as another tool corrected it, encoded for a screen.
    """

    raw: Image
    shown: SurveyFrame
    others: Mapping[str, Image] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Ready:
    """A frame ready to be compared. views: (H, W, 3) linear light, means of windows, by method."""

    views: tuple[NDArray[np.float32], ...]
    range_m: Map
    features: Features

    @classmethod
    def of(cls, frame: ComparedFrame, geometry: RectifiedPair, encoding: InputEncoding) -> "_Ready":
        shown = [frame.shown.color, *frame.others.values()]
        views = (_light(frame.raw, encoding), *(_light(image, "srgb") for image in shown))
        return cls(views, frame.shown.range_m, detect(frame.shown, geometry))


def measure_spread(
    frames: Sequence[ComparedFrame], geometry: RectifiedPair, encoding: InputEncoding
) -> SpreadReport:
    """Compare the frames; each is read once, in order. encoding: of the raw images.

    Raises InputError where no two frames show the same spots.
    """
    ranged: list[_Ranged] = []
    ready = (_Ready.of(frame, geometry, encoding) for frame in frames)
    pairs = list(_compared(_noted(ready, ranged), geometry))
    if not pairs:
        raise InputError(
            "no two frames up to four apart show the same spots: there is nothing to compare"
        )
    places, range_m = (
        [pair.edges for pair in pairs],
        np.concatenate([frame.range_m for frame in ranged]),
    )
    raw, corrected, *others = (
        _spread(
            [pair.views[view] for pair in pairs],
            places,
            range_m,
            np.concatenate([frame.views[view] for frame in ranged]),
        )
        for view in range(len(pairs[0].views))
    )
    methods = frames[0].others if others else ()
    return SpreadReport(raw, corrected, dict(zip(methods, others, strict=True)), len(pairs))


@dataclass(frozen=True, eq=False)
class _Ranged:
    """Some pixels of a frame, by range. range_m (N,). views: (N, 3) linear light, as of _Ready."""

    range_m: Array
    views: list[Array]


def _noted(frames: Iterable[_Ready], ranged: list[_Ranged]) -> Iterator[_Ready]:
    """The frames, of each of which some pixels are added to ``ranged``."""
    for number, frame in enumerate(frames):
        known = np.flatnonzero(np.isfinite(frame.range_m))
        some = np.random.default_rng(number).choice(
            known, min(SETTINGS.ranged_points, known.size), replace=False
        )
        views = [view.reshape(-1, 3)[some].astype(np.float64) for view in frame.views]
        ranged.append(_Ranged(frame.range_m.ravel()[some].astype(np.float64), views))
        yield frame


@dataclass(frozen=True, eq=False)
class _Pair:
    """The spots of a pair of frames. views: (N, 2, 3) in both: raw, corrected, and each other
    method's. edges (N, 2): distance of each from the image's border, fraction of its width or
    height.
    """

    views: list[Array]
    edges: Array


def _compared(frames: Iterable[_Ready], geometry: RectifiedPair) -> Iterator[_Pair]:
    """The spots of each pair of frames."""
    last: list[_Ready] = []
    for number, ready in enumerate(frames):
        for other in last:
            found = relative_pose(other.features, ready.features, geometry)
            if found is not None:
                at, there = _same_spots(
                    other.range_m, ready.range_m, inverse(found.T_a_b), geometry, number
                )
                views = zip(other.views, ready.views, strict=True)
                yield _Pair(
                    [np.stack([a[at], b[there]], axis=1).astype(np.float64) for a, b in views],
                    np.stack(
                        [_edge(at, ready.range_m.shape), _edge(there, ready.range_m.shape)], axis=1
                    ),
                )
        last = [*last, ready][-SETTINGS.apart :]


def _edge(at: "Pixels", shape: tuple[int, ...]) -> Array:
    """(N,) distance of pixels from the border of their image."""
    part = np.stack([at[0] / shape[0], at[1] / shape[1]])
    return np.asarray(np.minimum(part, 1 - part).min(axis=0))


Pixels = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows and columns."""


def _same_spots(
    range_m: Map, other_m: Map, T_other_this: Array, geometry: RectifiedPair, seed: int
) -> tuple[Pixels, Pixels]:
    """Pixels of a frame and of another that show the same spots. seed: of the random choice."""
    height, width = range_m.shape
    edge = SETTINGS.window_px // 2 + 1
    known = np.isfinite(range_m)
    known[:edge] = known[-edge:] = known[:, :edge] = known[:, -edge:] = False
    among = np.flatnonzero(known)
    drawn = np.random.default_rng(seed).choice(
        among, min(SETTINGS.points, among.size), replace=False
    )
    rows, columns = np.divmod(drawn, width)
    moved = transform_points(
        T_other_this, geometry.points_from_range(range_m)[rows, columns].astype(np.float64)
    )
    x, y = geometry.project(moved).T
    inside = (
        (moved[:, 2] > 0)
        & (x > edge)
        & (y > edge)
        & (x < width - 1 - edge)
        & (y < height - 1 - edge)
    )
    rows, columns, moved = rows[inside], columns[inside], moved[inside]
    there = np.rint(y[inside]).astype(int), np.rint(x[inside]).astype(int)
    distance_m = np.linalg.norm(moved, axis=1)
    same = np.abs(other_m[there] - distance_m) < SETTINGS.agreement * distance_m
    return (rows[same], columns[same]), (there[0][same], there[1][same])


def _light(image: Image, encoding: InputEncoding) -> NDArray[np.float32]:
    light = decoded_values(8 * image.dtype.itemsize, encoding)[image]
    return np.asarray(cv2.blur(light, (SETTINGS.window_px, SETTINGS.window_px)))


def _spread(pairs: Sequence[Array], edges: Sequence[Array], range_m: Array, light: Array) -> Spread:
    """The differences between views. pairs: of each pair of frames, (N, 2, 3) linear light of its
    spots in both. edges: (N, 2)
    their distances from the border. range_m, light: (M,) and (M, 3) of pixels of all frames.
    """
    ratios, angles, squares, borders = [], [], [], []
    for views, edge in zip(pairs, edges, strict=True):
        good = ((views > SETTINGS.darkest) & (views < SETTINGS.brightest)).all(axis=(1, 2))
        usable = views[good]
        borders.append(_border(usable, edge[good]))
        ratio = np.log(usable[:, 0] @ LUMINANCE) - np.log(usable[:, 1] @ LUMINANCE)
        unit = usable / np.linalg.norm(usable, axis=2, keepdims=True)
        ratios.append(ratio)
        angles.append(np.degrees(np.arccos(np.clip((unit[:, 0] * unit[:, 1]).sum(axis=1), -1, 1))))
        if ratio.size >= SETTINGS.least:
            squares.append(float(np.median(ratio)) ** 2)
    every, angle = np.concatenate(ratios), np.concatenate(angles)
    if not every.size:
        raise InputError("no spot is bright enough in two frames: there is nothing to compare")
    trend, error = _median_and_error([border for border in borders if border is not None])
    return Spread(
        luminance=deviation(every),
        frame_offsets=float(np.sqrt(np.mean(squares))) if squares else float("nan"),
        angle_deg=float(np.median(angle)),
        spots=int(every.size),
        border=trend,
        border_error=error,
        far_red_to_blue=_far_red_to_blue(range_m, light),
    )


def _border(views: Array, edges: Array) -> Array | None:
    """(3,) median logarithm of border over center of a pair's spots (``Spread.border``); None where
    too few lie so.
    """
    logs = np.log(views)
    ratios = np.stack(
        [np.log(views @ LUMINANCE), logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]],
        axis=-1,
    )
    outer, inner = edges < SETTINGS.border, edges > SETTINGS.center
    first, second = outer[:, 0] & inner[:, 1], inner[:, 0] & outer[:, 1]
    found = np.concatenate(
        [(ratios[:, 0] - ratios[:, 1])[first], (ratios[:, 1] - ratios[:, 0])[second]]
    )
    return np.median(found, axis=0) if len(found) >= SETTINGS.least else None


Three = tuple[float, float, float]
UNKNOWN: Three = (np.nan, np.nan, np.nan)


def _median_and_error(borders: Sequence[Array]) -> tuple[Three, Three]:
    """The median over pairs of frames, and its standard error from their scatter; pairs share
    frames, so that a quarter counts.
    """
    if len(borders) < 2:
        return UNKNOWN, UNKNOWN
    independent = max(len(borders) / SETTINGS.apart, 1.0)
    middle, scatter = (
        np.median(borders, axis=0),
        np.array([deviation(part) for part in np.transpose(borders)]),
    )
    return _three(middle), _three(scatter / np.sqrt(independent))


def _three(values: Array) -> Three:
    first, second, third = map(float, values)
    return first, second, third


def _far_red_to_blue(range_m: Array, light: Array) -> float:
    """Red over blue of the farthest pixels over that of the nearest; NaN where there are none."""
    near, far = np.quantile(range_m, [SETTINGS.nearest, 1 - SETTINGS.farthest])
    usable = ((light > SETTINGS.darkest) & (light < SETTINGS.brightest)).all(axis=1)
    sums = [light[usable & which].sum(axis=0) for which in (range_m >= far, range_m <= near)]
    return (
        float(sums[0][0] / sums[0][2] / (sums[1][0] / sums[1][2]))
        if all((each > 0).all() for each in sums)
        else float("nan")
    )
