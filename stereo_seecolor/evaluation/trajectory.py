"""An estimated track against the true one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.geometry import rigid_alignment, transformed


@dataclass(frozen=True)
class TrajectoryError:
    """rms_m: absolute trajectory error after a rigid alignment (no scale). path_m: length of the true track."""

    rms_m: float
    path_m: float

    @property
    def fraction(self) -> float:
        """The error as a fraction of the path."""
        return self.rms_m / self.path_m


def trajectory_error(estimate_m: NDArray[np.float64], truth_m: NDArray[np.float64]) -> TrajectoryError:
    """Absolute trajectory error of positions (N, 3) in the order they were taken (Sturm et al. 2012)."""
    off_m = transformed(rigid_alignment(estimate_m, truth_m), estimate_m) - truth_m
    path_m = float(np.linalg.norm(np.diff(truth_m, axis=0), axis=1).sum())
    return TrajectoryError(float(np.sqrt((off_m**2).sum(axis=1).mean())), path_m)
