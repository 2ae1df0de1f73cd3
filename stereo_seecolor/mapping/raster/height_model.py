"""A terrain in memory: heights and colors seen from straight above, and their standard errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.noise import averaged

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Terrain:
    """The highest surface over each cell of ``grid``: height_m (H, W), color (H, W, 3) 0..255 as
    float32; NaN where unknown.
    """

    grid: Grid
    height_m: NDArray[np.float64]
    color: NDArray[np.float32]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where there is a surface: (H, W) bool."""
        return np.isfinite(self.height_m)

    @property
    def slopes(self) -> NDArray[np.float64]:
        """The rise of the surface to the east and to the north: (2, H, W), NaN at holes."""
        rows, columns = np.gradient(self.height_m, self.grid.cell_m)
        return np.stack([columns, -rows])

    @property
    def points_m(self) -> NDArray[np.float64]:
        """The cells' centers on the surface: (H, W, 3)."""
        x, y = self.grid.centers(slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1]))
        return np.stack([x, y, self.height_m], axis=-1)

    def averaged(self, cells: int) -> "Terrain":
        """The terrain in cells that are so many times as long and wide, without colors; what does
        not fill one is left out.
        """
        grid = self.grid
        height_m = averaged(self.height_m, cells)
        coarse = Grid(
            grid.west_m, grid.north_m, cells * grid.cell_m, (height_m.shape[0], height_m.shape[1])
        )
        return Terrain(coarse, height_m, np.full((*height_m.shape, 3), np.nan, np.float32))


@dataclass(frozen=True, eq=False)
class TerrainErrors:
    """Standard errors of a terrain.

    std_m: (H, W) standard error of each height by its views, NaN where no frame's range was left.
    noise_m: the part of it by the errors of ranges, without what views differ by at edges, which
    roughens a surface. views: (H, W) frames behind each cell. correlation_m: distance over which
    errors of neighboring cells are correlated.
    """

    std_m: Array
    noise_m: Array
    views: NDArray[np.int32]
    correlation_m: float
