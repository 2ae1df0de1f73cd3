"""Rigid motions between neighboring pairs, fitted together with what is wrong with all disparities
and with the focal length.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.resampling import jackknife

Array = NDArray[np.float64]
POSE = 6
"""A turn (rad) and a shift (baselines) of each couple; then come the shared values."""
OFFSET, FOCAL, ROWS, COLUMNS, LATER, LATER_ROWS = range(6)
"""Shared values, to be added to disparities, pixels: an offset; an amount that grows over the rows
and one that grows over the columns, at half the image's height and width from the middle; and, at
the second moment alone, an offset and an amount that grows over the rows. FOCAL is the logarithm of
the focal length's factor."""
STEPS = np.array([1e-5] * 3 + [1e-4] * 3 + [1e-2, 1e-4, 1e-2, 1e-2, 1e-2, 1e-2])
"""Of numerical derivatives; a pose that moves by less has converged."""


@dataclass(frozen=True)
class FitSettings:
    """rounds: of Gauss-Newton; poses_first: how many of them leave the shared values alone.

    noise_px: where the loss turns from squares to absolute values. free: standard deviations of the
    shared values before anything is seen: couples that only move sideways hold no focal length.
    fixed: of one that is not free.
    """

    rounds: int = 40
    poses_first: int = 6
    noise_px: float = 0.15
    free: tuple[float, ...] = (30.0, 0.1, 10.0, 10.0, 10.0, 10.0)
    fixed: float = 1e-6


SETTINGS = FitSettings()


@dataclass(frozen=True, eq=False)
class SeenTwice:
    """The same n points at two moments: (n, 3) pixels x and y from the principal point, and
    disparity.

    roll_rad: of the right image against the left one by the rows at the first moment.
    """

    first: Array
    second: Array
    roll_rad: float = 0.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """values: (6,) shared values, 0 where they were not free. partial: (couples, 6) the same
    without each couple.

    std: (6,) standard errors, from the residuals and between couples; formal: from the residuals
    alone. rest_px: root mean square of the residuals.
    """

    values: Array
    partial: Array
    std: Array
    formal: Array
    rest_px: float


def fit_motions(couples: Sequence[SeenTwice], geometry: RectifiedPair, *free: int) -> Fitted:
    """Robust least squares of all couples' motions with the ``free`` of the values that they share.

    Raises LinAlgError where a couple's points hold no motion.
    """
    poses, shared = np.zeros((len(couples), POSE)), np.zeros(len(SETTINGS.free))
    deviations = np.full(len(shared), SETTINGS.fixed)
    deviations[list(free)] = np.array(SETTINGS.free)[list(free)]
    prior = (SETTINGS.noise_px / deviations) ** 2
    for number in range(SETTINGS.rounds):
        normals = [
            _normal(couple, np.append(pose, shared), geometry)
            for couple, pose in zip(couples, poses, strict=True)
        ]
        H = np.diag(prior) + sum(normal.H for normal in normals)
        g = -prior * shared + sum(normal.g for normal in normals)
        late = number >= SETTINGS.poses_first
        step = np.asarray(np.linalg.solve(H, g)) if late else np.zeros(len(shared))
        moved = np.array([normal.pose_step(step) for normal in normals])
        poses, shared = poses + moved, shared + step
        if number > SETTINGS.poses_first and (np.abs(moved) < STEPS[:POSE]).all():
            break
    without = np.array([shared + np.linalg.solve(H - normal.H, g - normal.g) for normal in normals])
    square = float(np.mean([normal.square for normal in normals]))
    formal = np.sqrt(np.diag(np.linalg.inv(H)) * square)
    std = np.hypot(jackknife(without), formal) if len(couples) > 1 else formal
    return Fitted(shared, without, std, formal, float(np.sqrt(square)))


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of the shared values, its pose eliminated: H (6, 6), g (6,). square:
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


def _normal(couple: SeenTwice, values: Array, geometry: RectifiedPair) -> _Normal:
    rest = _residuals(couple, values, geometry)
    slope = np.empty((*rest.shape, len(values)))
    for i, size in enumerate(STEPS):
        moved = values.copy()
        moved[i] += size
        slope[:, :, i] = (_residuals(couple, moved, geometry) - rest) / size
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


def _residuals(couple: SeenTwice, values: Array, geometry: RectifiedPair) -> Array:
    """(n, 3) pixels by which the points, moved from the first moment, miss those of the second."""
    turn, shift, shared = values[:3], values[3:POSE], values[POSE:]
    scale = geometry.focal_px * np.exp(shared[FOCAL])
    first = corrected_points(couple.first, shared[[OFFSET, COLUMNS, ROWS]], geometry) / scale
    later = shared[[OFFSET, COLUMNS, ROWS]] + [shared[LATER], 0, shared[LATER_ROWS]]
    second = corrected_points(couple.second, later, geometry) / scale
    R = cv2.Rodrigues(turn)[0]
    rays = np.column_stack([first[:, :2], np.ones(len(first))]) @ R.T + first[:, 2:] * shift
    moved = np.column_stack([rays[:, :2], first[:, 2]]) / rays[:, 2:]
    return np.asarray((moved - second) * scale)


def corrected_points(points: Array, wrong_px: Array, geometry: RectifiedPair) -> Array:
    """(n, 3) points with what is wrong added to their disparities: an offset, over columns, over
    rows.
    """
    half = np.array(geometry.image_size) / 2
    disparity = points[:, 2] + wrong_px[0] + points[:, :2] / half @ wrong_px[1:]
    return np.column_stack([points[:, :2], disparity])
