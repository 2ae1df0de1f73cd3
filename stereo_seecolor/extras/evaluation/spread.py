"""Differences of the same spots between the frames of a run; needs no truth.

Frames up to four apart are registered by matched features. Spots whose range agrees in both are compared: means of 5x5 pixels of
linear light, uncorrected and corrected.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.geometry import inverse, transformed
from stereo_seecolor.mapping.track.features import Features, detect
from stereo_seecolor.mapping.track.relative_pose import relative_pose
from stereo_seecolor.records import Image, Map, SurveyFrame
from stereo_seecolor.robust_statistics import deviation

Array = NDArray[np.float64]


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


SETTINGS = SpreadSettings()


@dataclass(frozen=True)
class Spread:
    """Differences between views. luminance: robust standard deviation (1.4826 MAD) of the logarithm of the ratio of two views.

    frame_offsets: rms over pairs of frames of its median. angle_deg: median angle between the two views' colors. spots: compared.
    """

    luminance: float
    frame_offsets: float
    angle_deg: float
    spots: int


@dataclass(frozen=True)
class SpreadReport:
    """Differences between views of the raw images, of the run's corrected ones, and of other tools', by method.

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
    """A frame ready to be compared. views: (H, W, 3) linear light, means of windows: raw, corrected, and of each other method."""

    views: tuple[NDArray[np.float32], ...]
    range_m: Map
    features: Features

    @classmethod
    def of(cls, frame: ComparedFrame, geometry: RectifiedPair, encoding: InputEncoding) -> "_Ready":
        shown = [frame.shown.color, *frame.others.values()]
        views = (_light(frame.raw, encoding), *(_light(image, "srgb") for image in shown))
        return cls(views, frame.shown.range_m, detect(frame.shown, geometry))


def measure_spread(frames: Sequence[ComparedFrame], geometry: RectifiedPair, encoding: InputEncoding) -> SpreadReport:
    """Compare the frames; each is read once, in order. encoding: of the raw images.

    Raises InputError where no two frames show the same spots.
    """
    ready = (_Ready.of(frame, geometry, encoding) for frame in frames)
    pairs = list(_compared(ready, geometry))
    if not pairs:
        raise InputError("no two frames up to four apart show the same spots: there is nothing to compare")
    raw, corrected, *others = (_spread([pair[view] for pair in pairs]) for view in range(len(pairs[0])))
    methods = frames[0].others if others else ()
    return SpreadReport(raw, corrected, dict(zip(methods, others, strict=True)), len(pairs))


def _compared(frames: Iterable[_Ready], geometry: RectifiedPair) -> Iterator[list[Array]]:
    """For each pair of frames the two views (N, 2, 3) of its spots: raw, corrected, and each other method's."""
    last: list[_Ready] = []
    for number, ready in enumerate(frames):
        for other in last:
            found = relative_pose(other.features, ready.features, geometry)
            if found is not None:
                at, there = _same_spots(other.range_m, ready.range_m, inverse(found.T_a_b), geometry, number)
                views = zip(other.views, ready.views, strict=True)
                yield [np.stack([a[at], b[there]], axis=1).astype(np.float64) for a, b in views]
        last = [*last, ready][-SETTINGS.apart :]


Pixels = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows and columns."""


def _same_spots(range_m: Map, other_m: Map, T_other_this: Array, geometry: RectifiedPair, seed: int) -> tuple[Pixels, Pixels]:
    """Pixels of a frame and of another that show the same spots. seed: of the random choice."""
    height, width = range_m.shape
    edge = SETTINGS.window_px // 2 + 1
    known = np.isfinite(range_m)
    known[:edge] = known[-edge:] = known[:, :edge] = known[:, -edge:] = False
    among = np.flatnonzero(known)
    drawn = np.random.default_rng(seed).choice(among, min(SETTINGS.points, among.size), replace=False)
    rows, columns = np.divmod(drawn, width)
    moved = transformed(T_other_this, geometry.points_from_range(range_m)[rows, columns].astype(np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (moved @ geometry.P_left.T / moved[:, 2:])[:, :2].T
    inside = (moved[:, 2] > 0) & (x > edge) & (y > edge) & (x < width - 1 - edge) & (y < height - 1 - edge)
    rows, columns, moved = rows[inside], columns[inside], moved[inside]
    there = np.rint(y[inside]).astype(int), np.rint(x[inside]).astype(int)
    distance_m = np.linalg.norm(moved, axis=1)
    same = np.abs(other_m[there] - distance_m) < SETTINGS.agreement * distance_m
    return (rows[same], columns[same]), (there[0][same], there[1][same])


def _light(image: Image, encoding: InputEncoding) -> NDArray[np.float32]:
    light = decoded_values(8 * image.dtype.itemsize, encoding)[image]
    return np.asarray(cv2.blur(light, (SETTINGS.window_px, SETTINGS.window_px)))


def _spread(pairs: Sequence[Array]) -> Spread:
    """The differences between views. pairs: of each pair of frames, (N, 2, 3) linear light of its spots in both."""
    ratios, angles, squares = [], [], []
    for views in pairs:
        usable = views[((views > SETTINGS.darkest) & (views < SETTINGS.brightest)).all(axis=(1, 2))]
        ratio = np.log(usable[:, 0] @ LUMINANCE) - np.log(usable[:, 1] @ LUMINANCE)
        unit = usable / np.linalg.norm(usable, axis=2, keepdims=True)
        ratios.append(ratio)
        angles.append(np.degrees(np.arccos(np.clip((unit[:, 0] * unit[:, 1]).sum(axis=1), -1, 1))))
        if ratio.size >= SETTINGS.least:
            squares.append(float(np.median(ratio)) ** 2)
    every, angle = np.concatenate(ratios), np.concatenate(angles)
    if not every.size:
        raise InputError("no spot is bright enough in two frames: there is nothing to compare")
    return Spread(
        deviation(every), float(np.sqrt(np.mean(squares))) if squares else float("nan"), float(np.median(angle)), int(every.size)
    )
