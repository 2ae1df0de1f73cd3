"""Matched points of both rectified images of a pair, to a fraction of a pixel, whose rows may differ."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.gray import to_gray
from calibration.plan import raw_points, rectified_points
from calibration.rectification import Rectification
from calibration.rig import StereoRig

Array = NDArray[np.float64]
Images = tuple[NDArray[np.generic], NDArray[np.generic]]


@dataclass(frozen=True)
class MatchLimits:
    """Decides which features are taken for the same point."""

    max_features: int = 3000  # of an image: 0.6 s, and 1,700 matches a pair on a coral reef
    ratio: float = 0.75  # nearest to second nearest descriptor (Lowe 2004, Int. J. Comput. Vis. 60, sec. 7.1: 0.8)
    max_row_fraction: float = 0.1  # of the image's height: rows may be off, but not anywhere
    return_px: float = 0.2  # flow there and back: more is a place that is not the same in both images
    stray_px: float = 2.0  # flow from where the features lie, which are good to a pixel
    window_px: int = 21  # of the flow; OpenCV's default
    step_px: int = 1  # features are looked for at this resolution, and refined at the images' own
    most_pixels: float = 6e6  # of an image that features are looked for in, or at a coarser step: 250 bytes a pixel


LIMITS = MatchLimits()
QUICK = MatchLimits(max_features=500, step_px=3)
"""An eighth of the time, and some 300 matches a pair on a coral reef: enough for a median."""


@dataclass(frozen=True, eq=False)
class Matches:
    """left, right: (n, 2) pixels of the same points in the images that are matched, or in the raw ones where it says raw."""

    left: Array
    right: Array


def find_matches(
    rectification: Rectification, left: NDArray[np.generic], right: NDArray[np.generic], limits: MatchLimits = LIMITS
) -> Matches:
    """Match a raw pair, (H, W) or (H, W, C), 8 or 16 bit: SIFT both ways, then refined by optical flow there and back."""
    return match_images(clear(rectification.apply_left(to_gray(left))), clear(rectification.apply_right(to_gray(right))), limits)


def match_images(first: NDArray[np.uint8], second: NDArray[np.uint8], limits: MatchLimits = LIMITS) -> Matches:
    """Match two gray images that ``clear`` made; their points are called left and right."""
    images = [first, second]
    at_first, at_second = _alike(images, limits)
    near = np.abs(at_first[:, 1] - at_second[:, 1]) < limits.max_row_fraction * first.shape[0]
    return _refine(images, at_first[near], at_second[near])


def same_points(points: Array, among: Array, within_px: float) -> NDArray[np.int64]:
    """(n,) index of the nearest point ``among`` (m, 2) to each of ``points`` (n, 2); -1 where none lies within that distance."""
    if not len(among):
        return np.full(len(points), -1)
    apart = np.hypot(points[:, None, 0] - among[None, :, 0], points[:, None, 1] - among[None, :, 1])
    nearest = apart.argmin(axis=1)
    return np.where(apart[np.arange(len(points)), nearest] <= within_px, nearest, -1)


def raw_matches(rig: StereoRig, pairs: Iterable[Images]) -> list[Matches]:
    """Find matched points of both raw images of each pair, by matching the rectified ones."""
    rectification = Rectification.from_rig(rig)
    found = [find_matches(rectification, left, right) for left, right in pairs]
    return [Matches(*raw_points(rig, matches.left, matches.right)) for matches in found]


def look_alikes(left: NDArray[np.generic], right: NDArray[np.generic]) -> Matches:
    """Points of the raw images that look alike, good to a pixel, wherever they lie and however they are turned; some are wrong."""
    at_left, at_right = _alike([clear(to_gray(image)) for image in (left, right)], LIMITS)
    return Matches(at_left.astype(np.float64), at_right.astype(np.float64))


def rectified_matches(rig: StereoRig, raw: Sequence[Matches]) -> list[Matches]:
    """Convert matches in raw pixels to the rectified images of ``rig``."""
    return [Matches(*rectified_points(rig, matches.left, matches.right)) for matches in raw]


def clear(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """With its local contrast equalized, so that dim water does not hide features."""
    return np.asarray(cv2.createCLAHE(2.0, (8, 8)).apply(image), np.uint8)


def _alike(images: list[NDArray[np.uint8]], limits: MatchLimits) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(n, 2) pixels of features of the first image, and of those of the second that look alike."""
    step_px = max(limits.step_px, math.ceil(math.sqrt(images[0].size / limits.most_pixels)))
    scale = 1 / step_px
    small = [cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) for image in images]
    sift = cv2.SIFT.create(nfeatures=limits.max_features)
    points, descriptors = zip(*(sift.detectAndCompute(image, None) for image in small), strict=True)
    if any(len(found) < 2 for found in points):
        return np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32)
    left, right = (np.array([point.pt for point in found], dtype=np.float32) for found in points)
    pairs = _mutual(descriptors[0], descriptors[1])
    middle_px = (step_px - 1) / 2  # the middle of a small pixel, in the image's own
    return left[pairs[:, 0]] * step_px + middle_px, right[pairs[:, 1]] * step_px + middle_px


def _mutual(left: NDArray[np.float32], right: NDArray[np.float32]) -> NDArray[np.int64]:
    """(n, 2) indices of descriptors that choose each other, each clearly before its second choice."""
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    chosen = []
    for a, b in ((left, right), (right, left)):
        both = [found for found in matcher.knnMatch(a, b, k=2) if len(found) == 2]
        chosen.append({first.queryIdx: first.trainIdx for first, second in both if first.distance < LIMITS.ratio * second.distance})
    pairs = [(i, j) for i, j in chosen[0].items() if chosen[1].get(j) == i]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _refine(images: list[NDArray[np.uint8]], left: NDArray[np.float32], right: NDArray[np.float32]) -> Matches:
    if len(left) == 0:
        return Matches(np.zeros((0, 2)), np.zeros((0, 2)))
    there, found = _follow(images[0], images[1], left, right)
    back, found_back = _follow(images[1], images[0], there, left)
    kept = (
        found
        & found_back
        & (np.abs(back - left).max(axis=1) < LIMITS.return_px)
        & (np.abs(there - right).max(axis=1) < LIMITS.stray_px)
    )
    return Matches(left[kept].astype(np.float64), there[kept].astype(np.float64))


def _follow(
    first: NDArray[np.uint8], second: NDArray[np.uint8], points: NDArray[np.float32], start: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points (n, 2) of the first image lie in the second, from ``start`` on, and whether they were found."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        points.reshape(-1, 1, 2),
        start.reshape(-1, 1, 2).copy(),
        winSize=(LIMITS.window_px, LIMITS.window_px),
        maxLevel=0,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(moved, dtype=np.float32).reshape(-1, 2), np.asarray(found == 1).reshape(-1)
