"""Rigid motions between pairs, fitted together with an offset of all disparities and a factor of the focal length."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.resampling import jackknife

Array = NDArray[np.float64]
POSE = 6
"""A turn (rad) and a shift (baselines) of each couple; then come the offset (px) and the logarithm of the focal length's factor."""
STEPS = np.array([1e-5] * 3 + [1e-4] * 3 + [1e-2, 1e-4])
"""Of numerical derivatives; a pose that moves by less has converged."""


@dataclass(frozen=True)
class FitSettings:
    """rounds: of Gauss-Newton; poses_first: how many of them leave offset and focal length alone.

    noise_px: where the loss turns from squares to absolute values. offset_px, focal: standard deviations of both before anything
    is seen, the latter of the logarithm: couples that only move sideways hold no focal length. fixed: of one that is not free.
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
    """The same n points at two moments: (n, 3) pixels x and y from the principal point, and disparity."""

    first: Array
    second: Array


@dataclass(frozen=True, eq=False)
class Fitted:
    """values: (2,) offset, pixels, and focal length, relative to the calibrated one. partial: (couples, 2) the same without each.

    std: (2,) standard errors, from the residuals and between couples.
    """

    values: Array
    partial: Array
    std: Array


def fit_motions(couples: Sequence[SeenTwice], focal_px: float, free_focal: bool = True) -> Fitted:
    """Robust least squares of all couples' motions with the offset and the focal length that they share.

    Raises LinAlgError where a couple's points hold no motion.
    """
    poses, shared = np.zeros((len(couples), POSE)), np.zeros(2)
    prior = (SETTINGS.noise_px / np.array([SETTINGS.offset_px, SETTINGS.focal if free_focal else SETTINGS.fixed])) ** 2
    for number in range(SETTINGS.rounds):
        normals = [_normal(couple, np.append(pose, shared), focal_px) for couple, pose in zip(couples, poses, strict=True)]
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
    """Normal equations of the shared values, its pose eliminated: H (2, 2), g (2,). square: weighted mean squared residual."""

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
    return _Normal(H[POSE:, POSE:] - H[POSE:, :POSE] @ by_shared, g[POSE:] - H[POSE:, :POSE] @ to_pose, to_pose, by_shared, square)


def _residuals(couple: SeenTwice, values: Array, focal_px: float) -> Array:
    """(n, 3) pixels by which the points, moved from the first moment, miss those of the second."""
    turn, shift, offset_px, focal = values[:3], values[3:6], values[6], values[7]
    scale = focal_px * np.exp(focal)
    first, second = ((points + np.array([0, 0, offset_px])) / scale for points in (couple.first, couple.second))
    R = cv2.Rodrigues(turn)[0]
    rays = np.column_stack([first[:, :2], np.ones(len(first))]) @ R.T + first[:, 2:] * shift
    moved = np.column_stack([rays[:, :2], first[:, 2]]) / rays[:, 2:]
    return np.asarray((moved - second) * scale)
