"""Sub-pixel matches of both rectified images of a pair; their rows may differ."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import Array
from calibration.gray import to_gray
from calibration.rectification import Rectification, raw_points, rectified_points
from calibration.rig import StereoRig
from calibration.verification.alignment import align
from calibration.verification.row_fits import explain

Images = tuple[NDArray[np.generic], NDArray[np.generic]]
SIFT_BYTES_A_PIXEL = 250
UNLIKE = 400.0**2
"""Squared distance of SIFT descriptors (length 512) that are hardly alike: what a feature without a
second choice near its row is compared with.
"""


@dataclass(frozen=True)
class MatchLimits:
    """Decides which features are taken for the same point."""

    max_features: int = 3000  # of an image: 0.6 s, and 1,700 matches a pair on a coral reef
    # nearest to second nearest descriptor (Lowe 2004, Int. J. Comput. Vis. 60, sec. 7.1: 0.8)
    ratio: float = 0.75
    max_row_fraction: float = 0.1  # of the image's height: rows may be off, but not anywhere
    # flow there and back: more is a place that is not the same in both images
    return_px: float = 0.2
    stray_px: float = 2.0  # flow from where the features lie, which are good to a pixel
    window_px: int = 21  # of the flow; OpenCV's default
    step_px: int = 1  # features are looked for at this resolution, and refined at the images' own
    # of an image that features are looked for in, or at a coarser step
    most_pixels: float = 6e6
    # of a pair: fewer are looked for again near their rows
    enough: int = 100
    # that again: of the image's height (rows of a rig that has drifted are off by some pixels);
    # few features lie there, so that a nearest one that is less clear is right as well
    band_fraction: float = 0.02
    band_ratio: float = 0.85
    # rows of right ones differ as those of their neighbors do; of two scenes 1 in 5 do by chance
    row_px: float = 2.0
    agreeing: float = 0.6
    least: int = 20

    def bytes_of(self, image_size: tuple[int, int]) -> float:
        """Memory that the features of one image take while they are looked for."""
        return SIFT_BYTES_A_PIXEL * min(math.prod(image_size), self.most_pixels)


MATCH_LIMITS = MatchLimits()
QUICK = MatchLimits(max_features=500, step_px=3, enough=60)
"""An eighth of the time, and some 300 matches a pair on a coral reef: enough for a median."""


@dataclass(frozen=True, eq=False)
class Matches:
    """left, right: (n, 2) pixels of the same points in the images that are matched, or in the raw
    ones where it says raw.
    """

    left: Array
    right: Array

    @classmethod
    def joined(cls, several: "Sequence[Matches]") -> "Matches":
        """The matches of several pairs, one after the other."""
        none = np.zeros((0, 2))
        return cls(
            np.concatenate([none, *(one.left for one in several)]),
            np.concatenate([none, *(one.right for one in several)]),
        )


def find_matches(
    rectification: Rectification,
    left: NDArray[np.generic],
    right: NDArray[np.generic],
    limits: MatchLimits = MATCH_LIMITS,
) -> Matches:
    """Match a raw pair, (H, W) or (H, W, C), 8 or 16 bit: SIFT both ways, then refined by optical
    flow there and back; where few are found, near their rows, and with windows that are deformed.
    """
    first = describe_left(rectification, left, limits)
    second = describe_right(rectification, right, limits)
    found = match_described(first, second, limits)
    if len(found.left) >= limits.enough:
        return found
    near = _match_near_rows(first, second, limits)
    return near if len(near.left) > len(found.left) else found


@dataclass(frozen=True, eq=False)
class Described:
    """A gray image (H, W) that ``clear`` made, and its features: points (n, 2), pixels of the
    image, and descriptors (n, 128).
    """

    image: NDArray[np.uint8]
    points: NDArray[np.float32]
    descriptors: NDArray[np.float32]


def describe(image: NDArray[np.uint8], limits: MatchLimits) -> Described:
    """Find the features of an image, at a coarser step where it is large."""
    step_px = max(limits.step_px, math.ceil(math.sqrt(image.size / limits.most_pixels)))
    small = cv2.resize(image, None, fx=1 / step_px, fy=1 / step_px, interpolation=cv2.INTER_AREA)
    found, descriptors = cv2.SIFT.create(nfeatures=limits.max_features).detectAndCompute(
        small, None
    )
    points = np.array([point.pt for point in found], np.float32).reshape(-1, 2)
    middle_px = (step_px - 1) / 2  # the middle of a small pixel, in the image's own
    return Described(image, points * step_px + middle_px, descriptors)


def describe_left(
    rectification: Rectification, image: NDArray[np.generic], limits: MatchLimits = MATCH_LIMITS
) -> Described:
    """Find the features of a raw left image, rectified."""
    return describe(clear(rectification.apply_left(to_gray(image))), limits)


def describe_right(
    rectification: Rectification, image: NDArray[np.generic], limits: MatchLimits = MATCH_LIMITS
) -> Described:
    """Find the features of a raw right image, rectified."""
    return describe(clear(rectification.apply_right(to_gray(image))), limits)


def match_described(first: Described, second: Described, limits: MatchLimits) -> Matches:
    """Match the features of two images, and refine their places."""
    at_first, at_second = _alike(first, second)
    near = np.abs(at_first[:, 1] - at_second[:, 1]) < limits.max_row_fraction * len(first.image)
    return _refine([first.image, second.image], at_first[near], at_second[near])


def _match_near_rows(first: Described, second: Described, limits: MatchLimits) -> Matches:
    """Match the features of two rectified images whose points lie near each other's rows, as the
    cameras of a wide rig see them; none where their rows do not agree, as of two scenes.
    """
    none = Matches.joined(())
    if min(len(first.points), len(second.points)) < limits.least:
        return none
    band_px = limits.band_fraction * len(first.image)
    apart = np.abs(first.points[:, None, 1] - second.points[None, :, 1]) > band_px
    pairs = _mutual(first.descriptors, second.descriptors, limits.band_ratio, apart)
    left, right = (
        described.points[pairs[:, side]].astype(np.float64)
        for side, described in enumerate((first, second))
    )
    right, agree = align(first.image, second.image, left, right)
    left, right = left[agree], right[agree]
    if len(left) < limits.least:
        return none
    _, rest = explain(right[:, 1] - left[:, 1], left - left.mean(axis=0))
    kept = np.abs(rest) < limits.row_px
    if kept.sum() < max(limits.least, limits.agreeing * len(left)):
        return none
    return Matches(left[kept], right[kept])


def same_points(points: Array, among: Array, within_px: float) -> NDArray[np.int64]:
    """(n,) index of the nearest point ``among`` (m, 2) to each of ``points`` (n, 2); -1 where none
    lies within that distance.
    """
    if not len(among):
        return np.full(len(points), -1)
    apart = np.hypot(points[:, None, 0] - among[None, :, 0], points[:, None, 1] - among[None, :, 1])
    nearest = apart.argmin(axis=1)
    return np.where(apart[np.arange(len(points)), nearest] <= within_px, nearest, -1)


def raw_matches(
    rig: StereoRig, pairs: Iterable[Images], limits: MatchLimits = MATCH_LIMITS
) -> list[Matches]:
    """Find matched points of both raw images of each pair, by matching the rectified ones."""
    rectification = Rectification.from_rig(rig)
    found = (find_matches(rectification, left, right, limits) for left, right in pairs)
    return [Matches(*raw_points(rig, one.left, one.right)) for one in found]


def similar_points(left: NDArray[np.generic], right: NDArray[np.generic]) -> Matches:
    """Points of raw images that look alike, good to a pixel, however turned; some are wrong."""
    at_left, at_right = _alike(
        *(describe(clear(to_gray(image)), MATCH_LIMITS) for image in (left, right))
    )
    return Matches(at_left.astype(np.float64), at_right.astype(np.float64))


def rectified_matches(rig: StereoRig, raw: Sequence[Matches]) -> list[Matches]:
    """Convert matches in raw pixels to the rectified images of ``rig``."""
    return [Matches(*rectified_points(rig, matches.left, matches.right)) for matches in raw]


def clear(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """With its local contrast equalized, so that dim water does not hide features."""
    return np.asarray(cv2.createCLAHE(2.0, (8, 8)).apply(image), np.uint8)


def _alike(first: Described, second: Described) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(n, 2) pixels of features of the first image, and of those of the second that look alike."""
    if min(len(first.points), len(second.points)) < 2:
        return np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32)
    pairs = _mutual(first.descriptors, second.descriptors)
    return first.points[pairs[:, 0]], second.points[pairs[:, 1]]


def _mutual(
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    ratio: float = MATCH_LIMITS.ratio,
    apart: NDArray[np.bool_] | None = None,
) -> NDArray[np.int64]:
    """(n, 2) indices of descriptors that choose each other, each clearly before its second
    choice. apart: (left, right) True of those that cannot be the same.

    All distances at once: SIFT's numbers are whole and small, so that the sums are exact.
    """
    squared = (
        np.square(left).sum(axis=1)[:, None] + np.square(right).sum(axis=1) - 2 * (left @ right.T)
    )
    if apart is not None:
        squared[apart] = UNLIKE
    of_left = _clearly_nearest(squared.copy(), ratio)
    of_right = _clearly_nearest(np.ascontiguousarray(squared.T), ratio)
    both = np.flatnonzero((of_left >= 0) & (of_right[of_left] == np.arange(len(left))))
    return np.column_stack([both, of_left[both]])


def _clearly_nearest(squared: NDArray[np.float32], ratio: float) -> NDArray[np.int64]:
    """(n,) column of the clearly least of each row (n, m), which is overwritten; else -1."""
    rows = np.arange(len(squared))
    nearest = squared.argmin(axis=1)
    first = squared[rows, nearest]
    squared[rows, nearest] = np.inf
    clear = first < ratio**2 * squared.min(axis=1)
    return np.where(clear, nearest, -1)


def _refine(
    images: list[NDArray[np.uint8]], left: NDArray[np.float32], right: NDArray[np.float32]
) -> Matches:
    if len(left) == 0:
        return Matches.joined(())
    there, found = _follow(images[0], images[1], left, right)
    back, found_back = _follow(images[1], images[0], there, left)
    kept = (
        found
        & found_back
        & (np.abs(back - left).max(axis=1) < MATCH_LIMITS.return_px)
        & (np.abs(there - right).max(axis=1) < MATCH_LIMITS.stray_px)
    )
    return Matches(left[kept].astype(np.float64), there[kept].astype(np.float64))


def _follow(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    points: NDArray[np.float32],
    start: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points (n, 2) of the first image lie in the second, and whether they were found."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        points.reshape(-1, 1, 2),
        start.reshape(-1, 1, 2).copy(),
        winSize=(MATCH_LIMITS.window_px, MATCH_LIMITS.window_px),
        maxLevel=0,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(moved, dtype=np.float32).reshape(-1, 2), np.asarray(found == 1).reshape(-1)
