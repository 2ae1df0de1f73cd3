"""The same patches of the reef in several frames, from ranges and poses."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import transform_points
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_values
from stereo_seecolor.records import Image, Map

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class ObservationSettings:
    """Size of patches, and conditions for an observation; tested on the sample dive."""

    patch_m: float = 0.05
    """Width of a patch on the reef, the same at any range."""
    same_range: float = 0.02
    """Ranges of the same patch agree to this fraction, which is more than the error of a range."""
    most_relief: float = 0.06
    """A patch is left out if the range varies more within ``relief_px``: an edge."""
    relief_px: int = 7
    """Side of a square, pixels."""
    clipped: float = 0.98
    """Light beyond this fraction of full scale may be clipped."""
    nearest_m: float = 0.05
    """Least depth in front of the camera for a projection."""
    most_clipped: float = 1e-6
    """Largest clipped fraction of a patch: 0, up to rounding of the integral image."""
    far_m: float = 1e6
    """Value of an unknown range in the search for edges, so that its neighbors are edges."""


SETTINGS = ObservationSettings()


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """image: rectified left, uncorrected. range_m: measured pixels only. T_world_camera: (4, 4)."""

    image: Image
    range_m: Map
    T_world_camera: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Observations:
    """patch: (N,) int64, 0..P-1, ascending, each at least twice. frame: (N,) int64, 0..F-1.
    range_m: (N,) m. light: (N, 3) linear, mean over the patch. pixel: (N, 2) x, y of its center.
    frames: (F,) number in the dive of each frame.
    """

    patch: NDArray[np.int64]
    frame: NDArray[np.int64]
    range_m: Vector
    light: Vector
    pixel: Vector
    frames: NDArray[np.int64]

    def part(self, chosen: NDArray[Any]) -> "Observations":
        """Some observations, by number or mask; patches keep their numbers."""
        parts = {name: part[chosen] for name, part in vars(self).items() if name != "frames"}
        return replace(self, **parts)

    def of_both(self, one: int, other: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of the observations of the patches that two frames show, in each of them."""
        first, there = (np.flatnonzero(self.frame == number) for number in (one, other))
        _, a, b = np.intersect1d(
            self.patch[first], self.patch[there], assume_unique=True, return_indices=True
        )
        return first[a], there[b]


def observations_of(
    points_m: Vector, views: "Iterable[PhotometricView]", frames: Sequence[int]
) -> Observations:
    """Find observations of (P, 3) patches in the views of these frames; two or more each."""
    seen = [view.look_at(points_m) for view in views]
    patch, range_m, light, pixel = map(np.concatenate, zip(*seen, strict=True))
    seen_by = np.repeat(np.arange(len(seen)), [len(patches) for patches, *_ in seen])
    several = np.bincount(patch, minlength=len(points_m))[patch] > 1
    order = np.flatnonzero(several)[np.argsort(patch[several], kind="stable")]
    compact = np.unique(patch[order], return_inverse=True)[1]
    every = Observations(patch, seen_by, range_m, light, pixel, np.array(frames))
    return replace(every.part(order), patch=compact)


@dataclass(frozen=True, eq=False)
class PhotometricView:
    """smooth_range_m: (H, W) range, NaN at edges. sums: (H + 1, W + 1, 4) integral image of linear
    R, G, B and of clipped pixels.
    """

    geometry: RectifiedPair
    T_world_camera: NDArray[np.float64]
    smooth_range_m: Map
    sums: Vector

    @classmethod
    def of(
        cls, frame: KeyFrame, geometry: RectifiedPair, encoding: InputEncoding | None
    ) -> "PhotometricView":
        """Make the view of a frame. encoding: of its image; None if only its ranges are needed."""
        sums = np.zeros((2, 2, 4))
        if encoding is not None:
            light = np.take(decoded_values(8 * frame.image.dtype.itemsize, encoding), frame.image)
            clipped = reduce(np.maximum, np.moveaxis(light, 2, 0)) >= SETTINGS.clipped
            light[clipped] = 0
            sums = cv2.integral(cv2.merge([light, clipped.astype(np.float32)]), sdepth=cv2.CV_64F)
        return cls(geometry, frame.T_world_camera, _without_edges(frame.range_m), sums)

    def patches_m(self, number: int) -> Vector:
        """Choose about ``number`` points in the world (P, 3), on a grid of pixels with range."""
        height, width = self.smooth_range_m.shape
        step = max(int(np.sqrt(height * width / max(number, 1))), 1)
        grid = np.zeros((height, width), np.bool_)
        grid[step // 2 :: step, step // 2 :: step] = True
        known = grid & np.isfinite(self.smooth_range_m)
        points = self.geometry.points_from_range(self.smooth_range_m)[known].astype(np.float64)
        return transform_points(self.T_world_camera, points)

    def look_at(self, points_m: Vector) -> tuple[NDArray[np.int64], Vector, Vector, Vector]:
        """Numbers (n,), ranges (n,), light (n, 3) and pixels (n, 2) of the visible patches."""
        farthest_m = float(np.fmax.reduce(self.smooth_range_m, axis=None, initial=0.0))
        away_m = points_m - self.T_world_camera[:3, 3]
        near = np.flatnonzero(
            np.linalg.norm(away_m, axis=1) < (1 + SETTINGS.same_range) * farthest_m
        )
        local = away_m[near] @ self.T_world_camera[:3, :3]
        range_m = np.linalg.norm(local, axis=1)
        x, y = self.geometry.project(local).T
        with np.errstate(divide="ignore"):
            half_px = 0.5 * SETTINGS.patch_m * self.geometry.focal_px / local[:, 2]
        height, width = self.smooth_range_m.shape
        inside = (local[:, 2] > SETTINGS.nearest_m) & (x - half_px > 0) & (y - half_px > 0)
        inside &= (x + half_px < width - 1) & (y + half_px < height - 1)
        x, y, half_px = (np.where(inside, value, 0.0) for value in (x, y, half_px))
        measured_m = self.smooth_range_m[np.round(y).astype(int), np.round(x).astype(int)]
        with np.errstate(invalid="ignore"):
            seen = inside & (np.abs(measured_m - range_m) < SETTINGS.same_range * range_m)
        near, range_m, x, y, half_px = (own[seen] for own in (near, range_m, x, y, half_px))
        corners = [
            self._sum_to(x + dx * half_px + 0.5, y + dy * half_px + 0.5)
            for dy in (-1, 1)
            for dx in (-1, 1)
        ]
        mean = (corners[3] - corners[2] - corners[1] + corners[0]) / (2 * half_px[:, None]) ** 2
        clear = mean[:, 3] < SETTINGS.most_clipped
        return near[clear], range_m[clear], mean[clear, :3], np.column_stack([x, y])[clear]

    def _sum_to(self, x: Vector, y: Vector) -> Vector:
        """(P, 4) sum over all pixels left of and above a point, fractions of pixels counted."""
        height, width = self.sums.shape[:2]
        c, r = (
            np.clip(np.floor(value).astype(int), 0, size - 2)
            for value, size in ((x, width), (y, height))
        )
        fx, fy = (x - c)[:, None], (y - r)[:, None]
        upper = self.sums[r, c] * (1 - fx) + self.sums[r, c + 1] * fx
        lower = self.sums[r + 1, c] * (1 - fx) + self.sums[r + 1, c + 1] * fx
        return np.asarray(upper * (1 - fy) + lower * fy)


def _without_edges(range_m: Map) -> Map:
    known = np.where(np.isfinite(range_m), range_m, np.float32(SETTINGS.far_m))
    spread = cv2.morphologyEx(
        known, cv2.MORPH_GRADIENT, np.ones((SETTINGS.relief_px, SETTINGS.relief_px), np.uint8)
    )
    return np.where(spread < SETTINGS.most_relief * known, range_m, np.float32(np.nan))
