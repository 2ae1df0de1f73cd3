"""Rigid motions between neighboring pairs, fitted with errors of disparity and focal length."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.resampling import jackknife
from calibration.verification.row_fits import explain

Array = NDArray[np.float64]
POSE = 6
"""A turn (rad) and a shift (baselines) of each couple; then come the shared values."""
OFFSET, FOCAL, ROWS, COLUMNS, LATER, LATER_ROWS = range(6)
"""Shared values, to be added to disparities, pixels: an offset; an amount that grows over the rows
and one that grows over the columns, at half the image's height and width from the middle; and, at
the second moment alone, an offset and an amount that grows over the rows. FOCAL is the logarithm of
the focal length's factor."""
STEPS = np.array([1e-5] * 3 + [1e-4] * 3)
"""A pose that moves by less has converged."""

AT_INFINITY = 0.1
"""Of the disparity: points without parallax fit any motion when an offset moves them to
infinity."""


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
            _normal(couple, np.concatenate((pose, shared)), geometry)
            for couple, pose in zip(couples, poses, strict=True)
        ]
        H = np.diag(prior) + sum(normal.H for normal in normals)
        g = -prior * shared + sum(normal.g for normal in normals)
        late = number >= SETTINGS.poses_first
        step = np.asarray(np.linalg.solve(H, g)) if late else np.zeros(len(shared))
        moved = np.array([normal.pose_step(step) for normal in normals])
        poses, shared = poses + moved, shared + step
        if number > SETTINGS.poses_first and (np.abs(moved) < STEPS).all():
            break
    disparity_px = float(np.median(np.concatenate([couple.first[:, 2] for couple in couples])))
    if disparity_px + shared[OFFSET] < AT_INFINITY * disparity_px:
        raise np.linalg.LinAlgError("no motion")
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
    rest, slope = _residuals(couple, values, geometry)
    squared = (rest**2).sum(axis=1)
    weights = 1 / np.sqrt(1 + squared / SETTINGS.noise_px**2)
    A, r = slope.reshape(-1, len(values)), rest.ravel()
    weighted = A * np.repeat(weights, 3)[:, None]
    H, g = A.T @ weighted, -weighted.T @ r
    H_pose, wanted = H[:POSE, :POSE].copy(), H[:POSE, POSE - 1 :].copy()
    H_pose[range(POSE), range(POSE)] += 1e-9 * H.diagonal()[:POSE]
    wanted[:, 0] = g[:POSE]
    solved = np.linalg.solve(H_pose, wanted)
    to_pose, by_shared = solved[:, 0], solved[:, 1:]
    square = float((weights * squared).sum() / max(3 * len(rest) - POSE, 1))
    return _Normal(
        H[POSE:, POSE:] - H[POSE:, :POSE] @ by_shared,
        g[POSE:] - H[POSE:, :POSE] @ to_pose,
        to_pose,
        by_shared,
        square,
    )


def _residuals(couple: SeenTwice, values: Array, geometry: RectifiedPair) -> tuple[Array, Array]:
    """(n, 3) pixels by which the points, moved from the first moment, miss those of the second; and
    (n, 3, 12) their derivatives by the values.
    """
    turn, shift, shared = values[:3], values[3:POSE], values[POSE:]
    scale = geometry.focal_px * np.exp(shared[FOCAL])
    first = corrected_points(couple.first, shared[[OFFSET, COLUMNS, ROWS]], geometry) / scale
    later = shared[[OFFSET, COLUMNS, ROWS]] + [shared[LATER], 0, shared[LATER_ROWS]]
    second = corrected_points(couple.second, later, geometry) / scale
    R, by_turn = cv2.Rodrigues(turn)
    slopes = first.copy()
    slopes[:, 2] = 1
    rays = slopes @ R.T + first[:, 2:] * shift
    moved = rays.copy()
    moved[:, 2] = first[:, 2]
    moved /= rays[:, 2:]

    half = np.array(geometry.image_size) / 2
    over = np.zeros((2, len(SETTINGS.free), len(first)))  # of disparities, at both moments
    for at, points in enumerate((couple.first, couple.second)):
        over[at, OFFSET] = 1
        over[at, ROWS], over[at, COLUMNS] = points[:, 1] / half[1], points[:, 0] / half[0]
    over[1, [LATER, LATER_ROWS]] = over[1, [OFFSET, ROWS]]
    of_rays = np.zeros((len(first), 3, len(values)))
    of_rays[:, :, :3] = (slopes @ by_turn.reshape(3, 3, 3).transpose(0, 2, 1)).transpose(1, 2, 0)
    of_rays[:, :, 3:POSE] = first[:, 2, None, None] * np.eye(3)
    of_rays[:, :, POSE:] = over[0].T[:, None] * (shift / scale)[:, None]
    of_rays[:, :, POSE + FOCAL] = -slopes[:, :2] @ R[:, :2].T - first[:, 2:] * shift
    # what is moved, without its division by depth: two coordinates of the ray, and the disparity
    of_moved = of_rays.copy()
    of_moved[:, 2] = 0
    of_moved[:, 2, POSE:] = over[0].T / scale
    of_moved[:, 2, POSE + FOCAL] = -first[:, 2]
    slope = (of_moved - moved[:, :, None] * of_rays[:, 2:]) * (scale / rays[:, 2])[:, None, None]
    slope[:, 2, POSE:] -= over[1].T
    slope[:, :, POSE + FOCAL] += moved * scale
    return np.asarray((moved - second) * scale), np.asarray(slope)


def corrected_points(points: Array, wrong_px: Array, geometry: RectifiedPair) -> Array:
    """(n, 3) points with what is wrong with their disparities: offset, columns, rows."""
    half = np.array(geometry.image_size) / 2
    corrected = points.copy()
    corrected[:, 2] += wrong_px[0]
    corrected[:, 2] += points[:, :2] / half @ wrong_px[1:]
    return corrected
