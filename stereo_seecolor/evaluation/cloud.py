"""The true surface as points, to judge a fused cloud by."""

import numpy as np
from numpy.typing import NDArray


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
            fraction = (k / steps[has])[:, None]
            pieces.append(start[has] * (1 - fraction) + end[has] * fraction)
    return np.concatenate(pieces)
