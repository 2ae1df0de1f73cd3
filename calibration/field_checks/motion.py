"""Errors of a calibration that vertical disparity does not show, from the motion between
neighboring pairs.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError, counted
from calibration.field_checks.matches import (
    QUICK,
    Images,
    Matches,
    describe_left,
    describe_right,
    jackknife,
    match_described,
    same_points,
)
from calibration.geometry import RectifiedPair
from calibration.rectification import Rectification

# Rigid motions between pairs, fitted together with an offset of all disparities and a factor of
# the focal length.

Array = NDArray[np.float64]
POSE = 6
"""A turn (rad) and a shift (baselines) of each couple; then come the offset (px) and the logarithm
of the focal length's factor.
"""
STEPS = np.array([1e-5] * 3 + [1e-4] * 3 + [1e-2, 1e-4])
"""Of numerical derivatives; a pose that moves by less has converged."""


@dataclass(frozen=True)
class FitSettings:
    """rounds: of Gauss-Newton; poses_first: how many of them leave offset and focal length alone.

    noise_px: where the loss turns from squares to absolute values. offset_px, focal: standard
    deviations of both before anything is seen, the latter of the logarithm: couples that only move
    sideways hold no focal length.
    fixed: of one that is not free.
    """

    rounds: int = 40
    poses_first: int = 6
    noise_px: float = 0.15
    offset_px: float = 30.0
    focal: float = 0.1
    fixed: float = 1e-6


SETTINGS = FitSettings()


@dataclass(frozen=True, eq=False)
class SeenTwice:
    """The same n points at two moments: (n, 3) pixels x and y from the principal point, and
    disparity.
    """

    first: Array
    second: Array


@dataclass(frozen=True, eq=False)
class Fitted:
    """values: (2,) offset, pixels, and focal length, relative to the calibrated one. partial:
    (couples, 2) the same without each.

    std: (2,) standard errors, from the residuals and between couples.
    """

    values: Array
    partial: Array
    std: Array


def fit_motions(couples: Sequence[SeenTwice], focal_px: float, free_focal: bool = True) -> Fitted:
    """Robust least squares of all couples' motions with the offset and the focal length that they
    share.

    Raises LinAlgError where a couple's points hold no motion.
    """
    poses, shared = np.zeros((len(couples), POSE)), np.zeros(2)
    prior = (
        SETTINGS.noise_px
        / np.array([SETTINGS.offset_px, SETTINGS.focal if free_focal else SETTINGS.fixed])
    ) ** 2
    for number in range(SETTINGS.rounds):
        normals = [
            _normal(couple, np.append(pose, shared), focal_px)
            for couple, pose in zip(couples, poses, strict=True)
        ]
        H = np.diag(prior) + sum(normal.H for normal in normals)
        g = -prior * shared + sum(normal.g for normal in normals)
        step = np.asarray(np.linalg.solve(H, g)) if number >= SETTINGS.poses_first else np.zeros(2)
        moved = np.array([normal.pose_step(step) for normal in normals])
        poses, shared = poses + moved, shared + step
        if number > SETTINGS.poses_first and (np.abs(moved) < STEPS[:POSE]).all():
            break
    without = np.array([shared + np.linalg.solve(H - normal.H, g - normal.g) for normal in normals])
    square = float(np.mean([normal.square for normal in normals]))
    std = np.hypot(jackknife(without), np.sqrt(np.diag(np.linalg.inv(H)) * square))
    return Fitted(shared, without, std)


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of the shared values, its pose eliminated: H (2, 2), g (2,). square:
    weighted mean squared residual.
    """

    H: Array
    g: Array
    to_pose: Array
    by_shared: Array
    square: float

    def pose_step(self, step: Array) -> Array:
        """(6,) the step of the pose for this step of the shared values."""
        return np.asarray(self.to_pose - self.by_shared @ step)


def _normal(couple: SeenTwice, values: Array, focal_px: float) -> _Normal:
    rest = _residuals(couple, values, focal_px)
    slope = np.empty((*rest.shape, len(values)))
    for i, size in enumerate(STEPS):
        moved = values.copy()
        moved[i] += size
        slope[:, :, i] = (_residuals(couple, moved, focal_px) - rest) / size
    weights = 1 / np.sqrt(1 + (rest**2).sum(axis=1) / SETTINGS.noise_px**2)
    A, r = slope.reshape(-1, len(values)), rest.ravel()
    weighted = A * np.repeat(weights, 3)[:, None]
    H, g = A.T @ weighted, -weighted.T @ r
    H_pose = H[:POSE, :POSE] + 1e-9 * np.diag(np.diag(H)[:POSE])
    solved = np.linalg.solve(H_pose, np.column_stack([g[:POSE], H[:POSE, POSE:]]))
    to_pose, by_shared = solved[:, 0], solved[:, 1:]
    square = float((weights * (rest**2).sum(axis=1)).sum() / max(3 * len(rest) - POSE, 1))
    return _Normal(
        H[POSE:, POSE:] - H[POSE:, :POSE] @ by_shared,
        g[POSE:] - H[POSE:, :POSE] @ to_pose,
        to_pose,
        by_shared,
        square,
    )


def _residuals(couple: SeenTwice, values: Array, focal_px: float) -> Array:
    """(n, 3) pixels by which the points, moved from the first moment, miss those of the second."""
    turn, shift, offset_px, focal = values[:3], values[3:6], values[6], values[7]
    scale = focal_px * np.exp(focal)
    first, second = (
        (points + np.array([0, 0, offset_px])) / scale for points in (couple.first, couple.second)
    )
    R = cv2.Rodrigues(turn)[0]
    rays = np.column_stack([first[:, :2], np.ones(len(first))]) @ R.T + first[:, 2:] * shift
    moved = np.column_stack([rays[:, :2], first[:, 2]]) / rays[:, 2:]
    return np.asarray((moved - second) * scale)


# Errors of the calibration that rows do not show, seen in the motion between neighboring pairs of
# a dive.
#
# An offset that all disparities have (images shifted along the baseline, a principal point, a yaw
# of a camera) and a focal length that is wrong in both cameras alike leave the rows as they are.
# But the bottom is rigid: between two moments, points move in the image by their true inverse
# depth, and by the turn of the camera. Disparities with an offset, or a wrong focal length, fit
# no rigid motion. The length of the baseline is not seen: all of it would be larger, alike.


@dataclass(frozen=True)
class MotionLimits:
    """Decides what is measured, and what is said of it.

    least_points, least_couples: fewer tell nothing, or give no standard error. least_move: median
    movement in the image, of its width: less holds too little parallax. most_row_px: rows of a rig
    that has drifted are off by a pixel or two.
    least_disparity_px: less is infinity, or one camera's picture on both sides. near_px: points
    that two matches have in common lie within it.
    lens_rad: offset, as an angle, that errors of a usual lens model look like; focal: the same of
    the focal length, relative. A real rig of 1360x1024 px, whose ranges fit the track of its
    survey, has 0.0014 and 0.02.
    known_focal: the focal length is fitted where its standard error is below that. range_error,
    deviations: ranges are said to be wrong where they are by more than both. seen: an error of
    ranges that would be found, else it is said to be unseen.
    """

    least_points: int = 20
    least_couples: int = 3
    least_move: float = 0.04
    most_row_px: float = 5.0
    least_disparity_px: float = 1.0
    near_px: float = 1.0
    lens_rad: float = 0.0015
    focal: float = 0.02
    known_focal: float = 0.015
    range_error: float = 0.05
    deviations: float = 2.0
    seen: float = 0.15


LIMITS = MotionLimits()
FEATURES = replace(QUICK, max_features=1000)
ANYWHERE = replace(FEATURES, max_row_fraction=1.0)


@dataclass(frozen=True)
class Motion:
    """What the motion between couples of pairs tells of the calibration; couples: 0 where too few
    show the same.

    offset_px: to be added to all disparities; focal: the true focal length over the calibrated one,
    less 1, NaN where it is not seen. range_error: of ranges at the median disparity by both,
    relative; at_m: the depth that this disparity gives as calibrated, meters. std: their standard
    errors, with those of a lens model.
    pixel_error: what a pixel of offset changes a range by, relative, for each meter of range.
    """

    couples: int = 0
    points: int = 0
    offset_px: float = 0.0
    offset_std_px: float = np.inf
    focal: float = np.nan
    focal_std: float = np.inf
    range_error: float = 0.0
    range_std: float = np.inf
    at_m: float = np.nan
    pixel_error: float = np.nan

    @property
    def is_known(self) -> bool:
        """True if an error of ranges that matters would have been seen."""
        return LIMITS.deviations * self.range_std < LIMITS.seen

    @property
    def is_right(self) -> bool:
        """True if ranges are right to within what is said to be wrong, their standard error
        included.
        """
        return abs(self.range_error) + self.range_std < LIMITS.range_error

    @property
    def is_found(self) -> bool:
        """True if ranges are wrong by more than the points and a usual lens model leave open."""
        return abs(self.range_error) > max(LIMITS.range_error, LIMITS.deviations * self.range_std)

    @property
    def line(self) -> str:
        """What was measured, or what is not seen, for a report."""
        if not (self.is_known or self.is_found):
            return (
                "not seen: images shifted along the baseline (a pixel changes ranges by "
                f"{self.pixel_error:.1%} for each meter of "
                "range), a focal length wrong in both cameras alike, a wrong baseline: rows do not "
                "show them, and too few neighboring pairs show "
                "the same bottom: compare a known length by stereo-seecolor measure or markers"
            )
        return (
            f"motion between {counted(self.couples, 'couple')} of neighboring pairs: "
            f"{self._figures}{self._unseen}"
        )

    @property
    def advice(self) -> str:
        """What is wrong and what to do."""
        return (
            f"neighboring pairs fit each other only with {self._figures}: images shifted along the "
            "baseline (a cut-out, stabilization, another mode, a wrong principal point), a camera "
            "turned sideways or another focal length, which rows hardly show: give images of the "
            "calibrated mode, or calibrate again, and compare a known length"
        )

    @property
    def _figures(self) -> str:
        offset = f"disparities {self.offset_px:+.1f} +- {self.offset_std_px:.1f} px longer"
        focal = (
            ""
            if np.isnan(self.focal)
            else f", a focal length {self.focal:+.0%} +- {self.focal_std:.0%} longer"
        )
        return (
            f"{offset}{focal}: ranges are off by {self.range_error:+.0%} +- {self.range_std:.0%} "
            f"where they come out as {self.at_m:.1f} m"
        )

    @property
    def _unseen(self) -> str:
        focal = "a focal length wrong in both cameras alike, " if np.isnan(self.focal) else ""
        return f"; not seen here: {focal}a wrong baseline"


NO_MOTION = Motion()


def find_motion(
    rectification: Rectification, starts: Iterable[Iterable[Images]], until_right: bool = False
) -> Motion:
    """Measure on raw image pairs. starts: for each couple its first pair and pairs that follow it,
    nearest first.

    The first of those that has moved far enough makes the couple. until_right: no more couples are
    looked at once the least number of them shows that ranges are right.
    """
    couples: list[SeenTwice] = []
    for pairs in starts:
        if couple := _couple(rectification, pairs):
            couples.append(couple)
            if until_right and len(couples) == LIMITS.least_couples:
                motion = motion_of(couples, rectification.matching_pair)
                if motion.is_right:
                    return motion
    return motion_of(couples, rectification.matching_pair)


def motion_of(couples: Sequence[SeenTwice], geometry: RectifiedPair) -> Motion:
    """Measure on points that were seen twice."""
    focal_px, pixel_error = geometry.focal_px, 1 / (geometry.focal_px * geometry.baseline_m)
    if len(couples) < LIMITS.least_couples:
        return Motion(pixel_error=pixel_error)
    try:
        fitted = fit_motions(couples, focal_px)
        focal_is_known = fitted.std[1] < LIMITS.known_focal
        fitted = fitted if focal_is_known else fit_motions(couples, focal_px, free_focal=False)
    except np.linalg.LinAlgError:  # points that hold no motion: all on a line
        return Motion(pixel_error=pixel_error)
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    offset_px, log_focal = map(float, fitted.values)
    lens_px, lens_focal = LIMITS.lens_rad * focal_px, LIMITS.focal * focal_is_known
    errors = (1 + fitted.partial[:, :1] / disparity_px) * np.exp(-fitted.partial[:, 1:])
    parts = [
        float(jackknife(errors)[0]),
        fitted.std[0] / disparity_px,
        lens_px / disparity_px,
        lens_focal,
    ]
    return Motion(
        couples=len(couples),
        points=sum(len(couple.first) for couple in couples),
        offset_px=offset_px,
        offset_std_px=float(np.hypot(fitted.std[0], lens_px)),
        focal=float(np.expm1(log_focal)) if focal_is_known else np.nan,
        focal_std=float(np.hypot(fitted.std[1], lens_focal)) if focal_is_known else np.inf,
        range_error=float((1 + offset_px / disparity_px) * np.exp(-log_focal) - 1),
        range_std=float(np.linalg.norm(parts)),
        at_m=focal_px * geometry.baseline_m / disparity_px,
        pixel_error=pixel_error,
    )


def _couple(rectification: Rectification, pairs: Iterable[Images]) -> SeenTwice | None:
    """The points that the first pair and the first one that has moved far enough show; None also
    for images of another size.
    """
    with suppress(CalibrationError):
        return _moved(rectification, iter(pairs))
    return None


def _moved(rectification: Rectification, pairs: Iterator[Images]) -> SeenTwice | None:
    start = next(pairs, None)
    if start is None:
        return None
    first = describe_left(rectification, start[0], FEATURES)
    for images in pairs:
        left = describe_left(rectification, images[0], FEATURES)
        moved = match_described(first, left, ANYWHERE)
        if len(moved.left) < LIMITS.least_points:
            return None
        if (
            np.median(np.abs(moved.left - moved.right).max(axis=1))
            >= LIMITS.least_move * left.image.shape[1]
        ):
            here, there = (
                match_described(seen, describe_right(rectification, right, FEATURES), FEATURES)
                for seen, (_, right) in ((first, start), (left, images))
            )
            return _seen_twice(rectification, here, moved, there)
    return None


def _seen_twice(
    rectification: Rectification, here: Matches, moved: Matches, there: Matches
) -> SeenTwice | None:
    """Points of the left images of both pairs, with their disparities at both moments."""
    geometry = rectification.matching_pair
    at_first, at_second = (
        same_points(moved.left, here.left, LIMITS.near_px),
        same_points(moved.right, there.left, LIMITS.near_px),
    )
    found = np.flatnonzero((at_first >= 0) & (at_second >= 0))
    kept, sides = np.ones(len(found), bool), []
    for left, matches, index in (
        (moved.left[found], here, at_first[found]),
        (moved.right[found], there, at_second[found]),
    ):
        disparity, row_px = (matches.left[index] - matches.right[index]).T
        disparity = disparity - (geometry.cx_left_px - geometry.cx_right_px)
        kept &= (np.abs(row_px) < LIMITS.most_row_px) & (disparity > LIMITS.least_disparity_px)
        sides.append(np.column_stack([left - [geometry.cx_left_px, geometry.cy_px], disparity]))
    return SeenTwice(sides[0][kept], sides[1][kept]) if kept.sum() >= LIMITS.least_points else None
