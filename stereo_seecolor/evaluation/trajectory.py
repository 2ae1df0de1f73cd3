"""An estimated track against the true one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TrajectoryError:
    """rms_m: absolute trajectory error after a rigid alignment (no scale). path_m: length of the true track."""

    rms_m: float
    path_m: float

    @property
    def share(self) -> float:
        """The error as a share of the path."""
        return self.rms_m / self.path_m


def align(estimate_m: NDArray[np.float64], truth_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) rigid transform, without scale, that brings (N, 3) estimated positions nearest to the true ones (Umeyama 1991)."""
    center, center_truth = estimate_m.mean(axis=0), truth_m.mean(axis=0)
    U, _, Vt = np.linalg.svd((truth_m - center_truth).T @ (estimate_m - center))
    R = U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, center_truth - R @ center
    return T


def trajectory_error(estimate_m: NDArray[np.float64], truth_m: NDArray[np.float64]) -> TrajectoryError:
    """Absolute trajectory error of positions (N, 3) in the order they were taken (Sturm et al. 2012)."""
    T = align(estimate_m, truth_m)
    off_m = estimate_m @ T[:3, :3].T + T[:3, 3] - truth_m
    path_m = float(np.linalg.norm(np.diff(truth_m, axis=0), axis=1).sum())
    return TrajectoryError(float(np.sqrt((off_m**2).sum(axis=1).mean())), path_m)
