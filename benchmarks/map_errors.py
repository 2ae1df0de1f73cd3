"""Errors of a map against the truth: of its track, and of its cloud against the true surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.transforms import rigid_alignment, transform_points
from stereo_seecolor.compute.threads import cores


@dataclass(frozen=True)
class TrajectoryError:
    """Error of a track. rms_m: absolute trajectory error after a rigid alignment (no scale).
    path_m: length of the true track.
    """

    rms_m: float
    path_m: float

    @property
    def fraction(self) -> float:
        """The error as a fraction of the path."""
        return self.rms_m / self.path_m


def trajectory_error(
    estimate_m: NDArray[np.float64], truth_m: NDArray[np.float64]
) -> TrajectoryError:
    """Absolute trajectory error of positions (N, 3) in the order they were taken (Sturm et al.
    2012).
    """
    off_m = transform_points(rigid_alignment(estimate_m, truth_m), estimate_m) - truth_m
    path_m = float(np.linalg.norm(np.diff(truth_m, axis=0), axis=1).sum())
    return TrajectoryError(float(np.sqrt((off_m**2).sum(axis=1).mean())), path_m)


def nearest_distance_m(
    queries_m: NDArray[np.floating], points_m: NDArray[np.floating], reach_m: float
) -> NDArray[np.float64]:
    """Distance of each query (N, 3) to the nearest of the points (M, 3), meters; infinite beyond
    ``reach_m``.
    """
    tree = cKDTree(points_m, balanced_tree=False, compact_nodes=False)
    bound = np.nextafter(reach_m, np.inf)  # scipy leaves out what lies exactly at its bound
    return np.asarray(
        tree.query(queries_m, distance_upper_bound=bound, workers=cores())[0], np.float64
    )


def surface_points(
    height_m: NDArray[np.floating], origin_m: tuple[float, float], cell_m: float
) -> NDArray[np.float64]:
    """Points of a height field (ny, nx), grid point (row, column) at origin + (column, row) * cell;
    steep walls are filled in.

    Between neighbors that differ by more than a cell in height, points are put every cell along the
    edge.
    """
    rows, columns = np.mgrid[: height_m.shape[0], : height_m.shape[1]]
    grid = np.stack(
        [origin_m[0] + columns * cell_m, origin_m[1] + rows * cell_m, height_m], axis=-1
    ).astype(np.float64)
    pieces = [grid.reshape(-1, 3)]
    for start, end in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:])):
        steps = np.ceil(np.abs(end[..., 2] - start[..., 2]) / cell_m)
        steep = steps > 1
        for k in range(1, int(steps.max(initial=0))):
            has = steep & (steps > k)
            fraction = (k / steps[has])[:, None]
            pieces.append(start[has] * (1 - fraction) + end[has] * fraction)
    return np.concatenate(pieces)
