"""A fused cloud against the true surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.evaluation.nearest import nearest_distance_m

REACH_M = 0.1


@dataclass(frozen=True)
class CloudError:
    """Distances in meters; a point with no truth within 0.1 m counts as 0.1 m.

    median_m, percentile_95_m: of the cloud's points to the nearest true one. completeness: share of the true points that have
    a point of the cloud within the tolerance.
    """

    median_m: float
    percentile_95_m: float
    completeness: float


def cloud_error(cloud_m: NDArray[np.floating], truth_m: NDArray[np.floating], tolerance_m: float) -> CloudError:
    """Compare a cloud (N, 3) with a dense sampling (M, 3) of the surface that was seen, in the same axes."""
    off_m = np.minimum(nearest_distance_m(cloud_m, truth_m, REACH_M), REACH_M)
    missing_m = nearest_distance_m(truth_m, cloud_m, REACH_M)
    return CloudError(float(np.median(off_m)), float(np.quantile(off_m, 0.95)), float(np.mean(missing_m <= tolerance_m)))


def surface_points(height_m: NDArray[np.floating], origin_m: tuple[float, float], cell_m: float) -> NDArray[np.float64]:
    """Points of a height field (ny, nx), grid point (row, column) at origin + (column, row) * cell; steep walls are filled in.

    Between neighbors that differ by more than a cell in height, points are put every cell along the edge.
    """
    rows, columns = np.mgrid[: height_m.shape[0], : height_m.shape[1]]
    grid = np.stack([origin_m[0] + columns * cell_m, origin_m[1] + rows * cell_m, height_m], axis=-1).astype(np.float64)
    pieces = [grid.reshape(-1, 3)]
    for start, end in ((grid[:-1], grid[1:]), (grid[:, :-1], grid[:, 1:])):
        steps = np.ceil(np.abs(end[..., 2] - start[..., 2]) / cell_m)
        steep = steps > 1
        for k in range(1, int(steps.max(initial=0))):
            has = steep & (steps > k)
            share = (k / steps[has])[:, None]
            pieces.append(start[has] * (1 - share) + end[has] * share)
    return np.concatenate(pieces)
