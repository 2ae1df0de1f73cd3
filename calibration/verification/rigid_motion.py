"""Rigid motions between neighboring pairs, fitted with errors of disparity and focal length."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.geometry import Array, RectifiedPair
from calibration.resampling import jackknife
from calibration.robust_statistics import deviation_about_zero
from calibration.verification.row_fits import explain

POSE = 6
"""A turn (rad) and a shift (baselines) of each couple; then come the shared values."""
SHARED = 7
OFFSET, FOCAL, ROWS, COLUMNS, LATER, LATER_ROWS, ASPECT = range(SHARED)
"""Shared values, to be added to disparities, pixels: an offset; an amount that grows over the rows
and one that grows over the columns, at half the image's height and width from the middle; and, at
the second moment alone, an offset and an amount that grows over the rows. FOCAL is the logarithm of
the focal length's factor, ASPECT that of a further one across the baseline."""
STEPS = np.array([1e-5] * 3 + [1e-4] * 3)
"""A pose that moves by less has converged."""

AT_INFINITY = 0.1
"""Of the disparity: points without parallax fit any motion when an offset moves them to
infinity."""
ROUNDS, POSES_FIRST = 40, 6
"""Of Gauss-Newton; and how many of them leave the shared values alone."""
NOISE_PX = 0.15
"""Where the loss turns from squares to absolute values."""
DEVIATIONS = (30.0, 0.1, 10.0, 10.0, 10.0, 10.0, 0.1)
"""Standard deviations of the shared values before anything is seen: couples that only move sideways
hold no focal length.
"""


@dataclass(frozen=True, eq=False)
class SeenTwice:
    """The same n points at two moments: (n, 3) pixels x, y from the principal point, disparity.

    rows_px: (n, 2) right minus left row at both moments; 0 unless stated otherwise.
    """

    first: Array
    second: Array
    rows_px: Array | None = None

    @property
    def roll_rad(self) -> float:
        """Of the right image against the left one, by the rows at the first moment."""
        if self.rows_px is None:
            return 0.0
        return float(explain(self.rows_px[:, 0], self.first[:, :2])[0][2])

    def pixels(self, geometry: RectifiedPair) -> tuple[tuple[Array, Array], ...]:
        """(n, 2) pixels in the left and the right image, at both moments."""
        rows_px = np.zeros((len(self.first), 2)) if self.rows_px is None else self.rows_px
        found = []
        for points, rows in zip((self.first, self.second), rows_px.T, strict=True):
            x, y, disparity = points.T
            left = np.column_stack([x + geometry.cx_left_px, y + geometry.cy_px])
            right = np.column_stack([x - disparity + geometry.cx_right_px, left[:, 1] + rows])
            found.append((left, right))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class Fitted:
    """values: (7,) shared values, 0 where they were not free. partial: (couples, 7) the same
    without each couple.

    std: (7,) standard errors, from the residuals and between couples; formal: from the residuals
    alone. rest_px: root mean square of the residuals. poses: (couples, 6).
    """

    values: Array
    partial: Array
    std: Array
    formal: Array
    rest_px: float
    poses: Array


def fit_motions(
    couples: Sequence[SeenTwice], geometry: RectifiedPair, *free: int, start: Fitted | None = None
) -> Fitted:
    """Robust least squares of all couples' motions with the ``free`` of the values that they share.

    start: a fit of the same couples whose values are near. Raises LinAlgError where a couple's
    points hold no motion.
    """
    points, chosen = _Points.of(couples, geometry, free), list(free)
    poses, shared = np.zeros((len(couples), POSE)), np.zeros(SHARED)
    if start is not None:
        poses, shared[chosen] = start.poses, start.values[chosen]
    prior = (NOISE_PX / np.array(DEVIATIONS)[chosen]) ** 2
    poses_first = POSES_FIRST if start is None else 0
    for number in range(ROUNDS):
        normals = _normals(points, poses, shared, geometry.focal_px)
        H = np.diag(prior) + normals.H.sum(axis=0)
        g = -prior * shared[chosen] + normals.g.sum(axis=0)
        late = number >= poses_first
        step = np.asarray(np.linalg.solve(H, g)) if late else np.zeros(len(free))
        moved = normals.to_pose - normals.by_shared @ step
        poses = poses + moved
        shared[chosen] += step
        if number > poses_first and (np.abs(moved) < STEPS).all():
            break
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    if disparity_px + shared[OFFSET] < AT_INFINITY * disparity_px:
        raise np.linalg.LinAlgError("no motion")
    partial, formal = np.tile(shared, (len(couples), 1)), np.zeros(SHARED)
    partial[:, chosen] += np.linalg.solve(H - normals.H, (g - normals.g)[..., None])[..., 0]
    square = float(normals.square.mean())
    formal[chosen] = np.sqrt(np.diag(np.linalg.inv(H)) * square)
    std = np.hypot(jackknife(partial), formal) if len(couples) > 1 else formal
    return Fitted(shared, partial, std, formal, float(np.sqrt(square)), poses)


def disparity_noise_px(
    fitted: Fitted, couples: Sequence[SeenTwice], geometry: RectifiedPair
) -> list[float]:
    """Standard deviation of the errors of each couple's disparities at the first moment that would
    explain what the motions leave: of few points, each motion takes up a part of these errors.
    """
    points = _Points.of(couples, geometry, (OFFSET, FOCAL, ROWS, COLUMNS))
    rest, slope = _residuals(points, fitted.poses, fitted.values, geometry.focal_px)
    by_first = slope[:, POSE + OFFSET] + np.array([[0.0], [0.0], [1.0]])
    error_px = (rest * by_first).sum(axis=1) / (by_first**2).sum(axis=1)
    return [
        deviation_about_zero(own[:count]) * float(np.sqrt(count / max(count - POSE, 1)))
        for own, count in zip(error_px, (len(couple.first) for couple in couples), strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Points:
    """The points of all couples at once: first, second (couples, 3, n). counts (couples, n): 1;
    0 where a couple has fewer points, which are repeated there.

    free: the F shared values to fit. over (2, couples, F, n): what 1 of each adds to a disparity at
    both moments.
    """

    first: Array
    second: Array
    counts: Array
    free: tuple[int, ...]
    over: Array

    @classmethod
    def of(
        cls, couples: Sequence[SeenTwice], geometry: RectifiedPair, free: tuple[int, ...]
    ) -> "_Points":
        number = np.array([len(couple.first) for couple in couples])
        most = int(number.max())
        moments = ([couple.first for couple in couples], [couple.second for couple in couples])
        both = np.stack([[np.resize(one, (most, 3)).T for one in moment] for moment in moments])
        x, y = (both[:, :, axis] / (geometry.image_size[axis] / 2) for axis in (0, 1))
        over = np.zeros((*both.shape[:2], SHARED, most))
        over[:, :, OFFSET], over[:, :, ROWS], over[:, :, COLUMNS] = 1, y, x
        over[1][:, [LATER, LATER_ROWS]] = over[1][:, [OFFSET, ROWS]]
        counts = (np.arange(most) < number[:, None]).astype(np.float64)
        return cls(both[0], both[1], counts, free, over[:, :, list(free)])


@dataclass(frozen=True, eq=False)
class _Normals:
    """Normal equations of the F free values by couple, its pose eliminated: H (couples, F, F),
    g (couples, F). to_pose (couples, 6), by_shared (couples, 6, F): the step of the pose, less what
    the step of the free values takes of it. square (couples,): weighted mean squared residual.
    """

    H: Array
    g: Array
    to_pose: Array
    by_shared: Array
    square: Array


def _normals(points: _Points, poses: Array, shared: Array, focal_px: float) -> _Normals:
    rest, slope = _residuals(points, poses, shared, focal_px)
    squared = (rest**2).sum(axis=1)
    weights = points.counts / np.sqrt(1 + squared / NOISE_PX**2)
    weighted = (slope * weights[:, None, None]).reshape(*slope.shape[:2], -1)
    H = weighted @ slope.reshape(weighted.shape).swapaxes(1, 2)
    g = -(weighted @ rest.reshape(len(rest), -1, 1))
    H_pose, of_pose = H[:, :POSE, :POSE].copy(), H[:, POSE:, :POSE]
    H_pose[:, range(POSE), range(POSE)] *= 1 + 1e-9
    solved = np.linalg.solve(H_pose, np.concatenate([g[:, :POSE], H[:, :POSE, POSE:]], axis=2))
    left = of_pose @ solved
    return _Normals(
        H[:, POSE:, POSE:] - left[..., 1:],
        g[:, POSE:, 0] - left[..., 0],
        solved[..., 0],
        solved[..., 1:],
        (weights * squared).sum(axis=1) / np.maximum(3 * points.counts.sum(axis=1) - POSE, 1),
    )


def _residuals(
    points: _Points, poses: Array, shared: Array, focal_px: float
) -> tuple[Array, Array]:
    """(couples, 3, n) pixels by which the points, moved from the first moment, miss those of the
    second; and (couples, 6 + F, 3, n) their derivatives by the pose and the free values.
    """
    turned = [cv2.Rodrigues(pose[:3]) for pose in poses]
    R, by_turn = np.stack([R for R, _ in turned]), np.stack([by for _, by in turned])
    shift, free = poses[:, 3:, None], shared[list(points.free)]
    scale = focal_px * np.exp(shared[FOCAL] + shared[ASPECT] * np.array([[0.0], [1.0], [0.0]]))
    first, second = points.first / scale, points.second / scale
    first[:, 2] += free @ points.over[0] / scale[2]
    second[:, 2] += free @ points.over[1] / scale[2]
    slopes, depth = first.copy(), first[:, 2:]
    slopes[:, 2] = 1
    rays = R @ slopes + depth * shift
    moved = np.concatenate([rays[:, :2], depth], axis=1) / rays[:, 2:]

    of_rays = np.zeros((len(poses), POSE + len(free), 3, rays.shape[2]))
    of_rays[:, :3] = by_turn.reshape(-1, 3, 3, 3) @ slopes[:, None]
    of_rays[:, range(3, POSE), range(3)] = depth
    of_rays[:, POSE:] = points.over[0][:, :, None] * (shift / scale[2])[:, None]
    # what is moved, without its division by depth: two coordinates of the ray, and the disparity
    of_moved = of_rays.copy()
    of_moved[:, :POSE, 2], of_moved[:, POSE:, 2] = 0, points.over[0] / scale[2]
    if FOCAL in points.free:
        at = POSE + points.free.index(FOCAL)
        of_rays[:, at] = -R[:, :, :2] @ slopes[:, :2] - depth * shift
        of_moved[:, at] = np.concatenate([of_rays[:, at, :2], -depth], axis=1)
    if ASPECT in points.free:
        across = POSE + points.free.index(ASPECT)
        of_rays[:, across] = -R[:, :, 1:2] @ slopes[:, 1:2]
        of_moved[:, across, :2] = of_rays[:, across, :2]
    slope = (of_moved - moved[:, None] * of_rays[:, :, 2:]) * (scale / rays[:, None, 2:])
    slope[:, POSE:, 2] -= points.over[1]
    if FOCAL in points.free:
        slope[:, at] += moved * scale
    if ASPECT in points.free:
        slope[:, across, 1] += moved[:, 1] * scale[1]
    return np.asarray((moved - second) * scale), np.asarray(slope)


def corrected_points(points: Array, wrong_px: Array, geometry: RectifiedPair) -> Array:
    """(..., 3) points with what is wrong with their disparities: offset, columns, rows."""
    half = np.array(geometry.image_size) / 2
    corrected = points.copy()
    corrected[..., 2] += wrong_px[0] + points[..., :2] / half @ wrong_px[1:]
    return corrected
