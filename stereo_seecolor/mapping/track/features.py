"""Features of a frame: points with descriptors, matched, and their positions in the camera."""

import shutil
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.raw_arrays import load_arrays
from stereo_seecolor.mapping.kept_frames import kept_folder
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.version import __version__

# SIFT keypoints and the matching of their descriptors, anywhere or near where they must be, for
# frames of a track and for whole maps.

CONTRAST = 0.01
"""SIFT's threshold, a quarter of Lowe's 0.04: hazy frames have little contrast."""
AT_ONCE = 128
"""Descriptors compared with all of the other image: their distances stay in the cache."""

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def keypoints(
    contrast: NDArray[np.uint8], mask: NDArray[np.uint8], most: int
) -> tuple[Array, NDArray[np.float32]]:
    """Find the ``most`` strongest keypoints: (n, 2) pixels, (0, 0) the middle of the first, and (n,
    128) descriptors (Lowe 2004).

    contrast: (H, W) as ``local_contrast`` gives it. mask: (H, W), 0 where none is looked for.
    """
    sift = cv2.SIFT.create(most, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    found, descriptors = sift.detectAndCompute(contrast, mask)
    if not found:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([k.pt for k in found], np.float64), np.asarray(descriptors, np.float32)


def match_descriptors(
    a: NDArray[np.float32], b: NDArray[np.float32], ratio: float
) -> tuple[Integers, Integers]:
    """Match descriptors a (n, 128) and b (m, 128): indices of those that are each other's nearest,
    and clearly nearer than the second nearest.

    ratio: Lowe's, of the two distances.
    """
    if min(len(a), len(b)) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    from_a = np.column_stack([-2 * a, (a * a).sum(1), np.ones(len(a), np.float32)])
    # one product gives squared distances
    from_b = np.column_stack([b, np.ones(len(b), np.float32), (b * b).sum(1)]).T
    nearest, least, second = np.zeros(len(a), np.int64), *np.zeros((2, len(a)), np.float32)
    least_of_b = np.full(len(b), np.inf, np.float32)
    for start in range(0, len(a), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        squared = from_a[part] @ from_b
        np.minimum(least_of_b, squared.min(axis=0), out=least_of_b)
        rows, best = np.arange(len(squared)), squared.argmin(axis=1)
        nearest[part], least[part] = best, squared[rows, best]
        squared[rows, best] = np.inf
        second[part] = squared.min(axis=1)
    chosen = np.flatnonzero((least < ratio**2 * second) & (least == least_of_b[nearest]))
    return chosen, nearest[chosen]


# Feature matching of two frames whose relative pose is roughly known: each feature is searched
# around its expected place alone.

Descriptors = NDArray[np.uint8]


def match_near(
    a: Descriptors, expected: Array, b: Descriptors, places: Array, reach: float, ratio: float
) -> tuple[Integers, Integers]:
    """Match features as ``match_descriptors`` does, but compare a feature of a (n, 128) only with
    those of b (m, 128) near its expected place.

    expected: (n, 2), NaN for features that b cannot show. places: (m, 2), within ``reach`` of that
    along both axes. A feature around whose place there is but one other matches none.
    """
    order = np.argsort(places[:, 0], kind="stable")
    sorted_places, sorted_b = np.ascontiguousarray(places[order]), np.ascontiguousarray(b[order])
    nearest, least, second = np.full(len(a), -1), np.full(len(a), np.inf), np.full(len(a), np.inf)
    least_of_b = np.full(len(b), np.inf)
    first = np.searchsorted(sorted_places[:, 0], expected[:, 0] - reach)
    _compare_near(
        a, expected, sorted_b, sorted_places, first, reach, nearest, least, second, least_of_b
    )
    chosen = np.flatnonzero(
        np.isfinite(second) & (least < ratio**2 * second) & (least == least_of_b[nearest])
    )
    return chosen, order[nearest[chosen]]


@compiled
def _compare_near(
    a: Any,  # (n, 128) uint8
    expected: Any,  # (n, 2) float64
    b: Any,  # (m, 128) uint8
    places: Any,  # (m, 2) float64, by their first number
    first: Any,  # (n,) int64, of ``places``, the first that may be near
    reach: float,
    nearest: Any,  # (n,) int64, written: of b, for those of a that have one near
    least: Any,  # (n,) float64, written: squared distance to it
    second: Any,  # (n,) float64, written: to the second nearest
    least_of_b: Any,  # (m,) float64, written
) -> None:
    """Squared distances of all that are near each other."""
    for i in range(len(a)):
        x, y = expected[i, 0], expected[i, 1]
        if not np.isfinite(x + y):
            continue
        for j in range(first[i], len(b)):
            if places[j, 0] > x + reach:
                break
            if abs(places[j, 1] - y) > reach:
                continue
            squared = np.int32(0)
            for k in range(128):
                off = np.int32(a[i, k]) - np.int32(b[j, k])
                squared += off * off
            if squared < least[i]:
                nearest[i], least[i], second[i] = j, squared, least[i]
            elif squared < second[i]:
                second[i] = squared
            least_of_b[j] = min(least_of_b[j], squared)


# Local contrast of an image, which light that falls off, or that moves with the camera, hardly
# changes.


@dataclass(frozen=True)
class ContrastSettings:
    """The neighborhood of local contrast. Nothing depends on the position in the image: a grid of
    tiles would move with the camera.
    """

    # standard deviation of the window whose mean is taken off: light varies less than the bottom
    # there
    mean_px: float = 8.0
    spread_px: float = 16.0  # and of the window that contrast is measured in
    # contrast, natural logarithm, below which there is only noise: sensor noise of a dark 8-bit
    # image
    noise: float = 0.02
    gain: float = 40.0  # gray levels for a standard deviation: three fit into 8 bits
    # added before the logarithm, gray levels: rounding to 8 bits makes dark pixels noisy
    offset: float = 4.0
    # widths of the means that fill in what was painted black
    fill_px: tuple[int, ...] = (9, 33, 129, 513)
    fill_known: float = 0.02  # of such a window: fewer known pixels make no mean


CONTRAST_SETTINGS = ContrastSettings()


def local_contrast(gray: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    """Compute the local contrast of a gray image (H, W), reduced by ``scale``: (h, w), the
    logarithm less its local mean, over its local spread, around 128.
    """
    filled = _filled(gray)
    if scale < 1:
        filled = cv2.resize(filled, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    logarithm = np.log(filled + np.float32(CONTRAST_SETTINGS.offset))
    detail = logarithm - cv2.GaussianBlur(logarithm, (0, 0), CONTRAST_SETTINGS.mean_px)
    spread = np.sqrt(cv2.GaussianBlur(detail * detail, (0, 0), CONTRAST_SETTINGS.spread_px))
    return np.asarray(
        np.clip(
            128 + CONTRAST_SETTINGS.gain * detail / (spread + CONTRAST_SETTINGS.noise),
            0,
            255,
        ),
        np.uint8,
    )


def _filled(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """With what was painted black for want of a range filled in smoothly: its rim is not an edge on
    the bottom.
    """
    known = (gray > 0).astype(np.float32)
    filled = gray.astype(np.float32)
    for width in CONTRAST_SETTINGS.fill_px:
        if known.all():
            break
        share = cv2.blur(known, (width, width))
        mean = cv2.blur(filled * known, (width, width)) / np.maximum(share, 1e-6)
        filled = np.where((known == 0) & (share > CONTRAST_SETTINGS.fill_known), mean, filled)
        known = np.where(share > CONTRAST_SETTINGS.fill_known, np.float32(1), known)
    return filled


# Smoothed inverse depth around pixels, by fitted planes: a plane, however it is tilted, is not
# changed.

Map = NDArray[np.float32]


@dataclass(frozen=True)
class SmoothingSettings:
    """When the depth around a pixel is used."""

    # inverse depths are averaged over it: as wide as their errors are correlated
    window_px: int = 9
    min_known: float = 0.6  # fraction of the window with a range
    max_spread_std: float = 3.0  # spread around a plane, in standard errors,
    # and as a fraction of the inverse depth: more is an edge, such as a fish's
    max_spread: float = 0.005
    unknown_std: float = 0.01  # standard error as a fraction of the range where it is not known


SMOOTHING_SETTINGS = SmoothingSettings()


@dataclass(frozen=True, eq=False)
class SmoothDepth:
    """Smoothed inverse depth at every so many pixels along both axes.

    inverse, std: (h, w) inverse depth and its standard error, 1/m. usable: (h, w), where it is
    measured and there is no edge.
    every: pixels from one sample to the next.
    """

    inverse: Map
    std: Map
    usable: NDArray[np.bool_]
    every: int

    def at(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """The inverse depth, its standard error and whether they are usable, (n,) each, at (n, 2)
        pixels of the frame.
        """
        places = (pixels - self.every // 2) / self.every
        columns, rows = np.clip(
            np.rint(places).astype(int), 0, np.array(self.usable.shape[::-1]) - 1
        ).T
        across, down = places.astype(np.float32).T
        inverse = cv2.remap(
            self.inverse, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ).ravel()
        usable = self.usable[rows, columns] & np.isfinite(inverse)
        return inverse.astype(np.float64), self.std[rows, columns].astype(np.float64), usable


def smooth_depth(frame: SurveyFrame, geometry: RectifiedPair, every: int) -> SmoothDepth:
    """Fit a plane to the inverse depths of each window; inverse depths of a plane are linear in
    pixels, ranges are not.

    every: that many pixels along each axis are skipped but for one: neighbors have errors in common
    and tell little more.
    """
    some = (slice(every // 2, None, every),) * 2
    measured_m, stated_m = frame.range_m[some], frame.range_std_m[some]
    known = np.isfinite(measured_m) & (frame.confidence[some] > 0)
    range_m = np.where(known, measured_m, np.float32(1))
    inverse = np.where(known, geometry.ray_length[some] / range_m, 0).astype(np.float32)
    width = _window(every)
    share = _mean(known.astype(np.float32), width)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = _mean(inverse, width) / share
        filled = np.where(known, inverse, mean)  # so that the windows' rims do not tilt the planes
        slope, mean_of = _slope(width)
        tilt = (
            cv2.sepFilter2D(filled, -1, slope, mean_of) ** 2
            + cv2.sepFilter2D(filled, -1, mean_of, slope) ** 2
        )
        variance = _mean(inverse * inverse, width) / share - mean**2 - tilt * (width**2 - 1) / 12
        std_m = np.where(np.isfinite(stated_m), stated_m, SMOOTHING_SETTINGS.unknown_std * range_m)
        std = std_m * inverse / range_m
        smooth = (
            np.sqrt(np.maximum(variance, 0))
            < SMOOTHING_SETTINGS.max_spread_std * std + SMOOTHING_SETTINGS.max_spread * mean
        )
    usable = known & (share > SMOOTHING_SETTINGS.min_known) & smooth
    return SmoothDepth(mean.astype(np.float32), std.astype(np.float32), usable, every)


def _window(every: int) -> int:
    """The window's width in the pixels that are left: odd, and three at least."""
    return max(3, SMOOTHING_SETTINGS.window_px // every // 2 * 2 + 1)


def _mean(values: Map, width: int) -> Map:
    return np.asarray(cv2.blur(values, (width, width)), np.float32)


def _slope(width: int) -> tuple[Map, Map]:
    """Kernels along and across an axis whose product is the slope of the plane of least squares
    along it.
    """
    offsets = np.arange(width, dtype=np.float32) - width // 2
    return offsets / np.float32((offsets**2).sum()), np.full(width, 1 / width, np.float32)


@dataclass(frozen=True)
class FeatureSettings:
    """How features are found."""

    # Both were measured: docs/lab/mapping.md.
    # a frame: some 300 matches remain at 60 % overlap; fewer make some tracks worse
    max_features: int = 2000
    # images are reduced to it: a track is as exact as at 960, in half of the time
    max_width_px: int = 640
    # how well SIFT finds a point again (measured on the synthetic reef)
    lateral_std_px: float = 0.3


FEATURE_SETTINGS = FeatureSettings()


@dataclass(frozen=True, eq=False)
class Features:
    """The features of a frame.

    points: (n, 3) in image space, x / z, y / z and 1 / z of the camera's coordinates, 1 / z in 1/m.
    std: (n, 3) their errors.
    descriptors: (n, 128) uint8. In image space errors are symmetric; in meters they are not, the
    less so the farther a point.
    """

    points: Array
    std: Array
    descriptors: NDArray[np.uint8]

    @classmethod
    def none(cls) -> "Features":
        """Make the features of a frame that shows nothing."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 128), np.uint8))

    def scaled(self, scale: float) -> "Features":
        """Scale the ranges by a factor."""
        by = np.array([1, 1, 1 / scale])
        return Features(self.points * by, self.std * by, self.descriptors)

    @property
    def points_m(self) -> Array:
        """The points in the camera: (n, 3) meters."""
        return np.column_stack([self.points[:, :2], np.ones(len(self.points))]) / self.points[:, 2:]


def detect(
    frame: SurveyFrame, geometry: RectifiedPair, settings: FeatureSettings = FEATURE_SETTINGS
) -> Features:
    """SIFT (Lowe 2004) on the image of local contrast, kept where the range is measured and smooth
    all around.
    """
    gray: NDArray[np.uint8] = cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)
    scale = min(1.0, settings.max_width_px / gray.shape[1])
    contrast = local_contrast(gray, scale)
    depth = smooth_depth(frame, geometry, int(1 / scale))
    mask = cv2.resize(
        depth.usable.astype(np.uint8), contrast.shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    found, descriptors = keypoints(contrast, mask, settings.max_features)
    if not len(found):
        return Features.none()
    pixels = (found + 0.5) / scale - 0.5
    inverse, inverse_std, good = depth.at(pixels)
    directions = (pixels[good] - [geometry.cx_left_px, geometry.cy_px]) / geometry.focal_px
    lateral = np.full(len(directions), settings.lateral_std_px / (geometry.focal_px * scale))
    points = np.column_stack([directions, inverse[good]])
    std = np.column_stack([lateral, lateral, inverse_std[good]])
    return Features(points, std, np.rint(descriptors[good]).astype(np.uint8))


# Features of a survey's frames on disk: memory stays bounded, workers share them, and a track
# that was stopped continues.

HELD = 64
"""Frames whose features a process holds, some 0.4 MB each: neighbors are asked for again and
again.
"""


class FeatureStore(Lazy[Features]):
    """A folder with one file a frame, asked for by the frame's position on the track. names: of the
    files, by position.
    """

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._folder, self._names = folder, names

    @classmethod
    def of(cls, survey: Survey) -> "FeatureStore":
        """Open the store of a survey's frames; features that an earlier run found in the same
        frames are kept.
        """
        index = survey.index
        if survey.scratch is None:
            return _Temporary([f"{number}.npz" for number in index.order.tolist()])
        names = [f"{number}_{index.checksums[number]:08x}.npz" for number in index.order.tolist()]
        key = content_key(__version__, FEATURE_SETTINGS, survey.geometry)
        return cls(kept_folder(survey.scratch / "features", key), names)

    def __len__(self) -> int:
        return len(self._names)

    def item(self, number: int) -> Features:
        """Read the features of the frame at a position. Raises FileNotFoundError where they were
        not found yet.
        """
        return _loaded(self._path(number))

    def has(self, number: int) -> bool:
        """Tell whether the features of a frame are stored."""
        return self._path(number).is_file()

    def save(self, number: int, features: Features) -> None:
        """Write the features of a frame. Raises OutputError."""
        with atomic_path(self._path(number)) as path, path.open("wb") as file:
            np.savez(
                file, points=features.points, std=features.std, descriptors=features.descriptors
            )

    def _path(self, number: int) -> Path:
        return self._folder / self._names[number]


class _Temporary(FeatureStore):
    """In a folder that goes with this object."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(Path(tempfile.mkdtemp(prefix="stereo-seecolor-")), names)
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)


@lru_cache(maxsize=HELD)
def _loaded(path: Path) -> Features:
    return Features(**load_arrays(path))
