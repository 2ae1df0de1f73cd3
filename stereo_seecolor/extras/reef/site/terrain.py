"""Terrain of a mesh: heights and colors seen from straight above, on a grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.site.mesh import SiteMesh
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.rasterize import rasterize


@dataclass(frozen=True, eq=False)
class Terrain:
    """The highest surface over each cell of ``grid``: height_m (H, W), color (H, W, 3) 0..255 as float32; NaN where unknown."""

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
        """The terrain in cells that are so many times as long and wide, without colors; what does not fill one is left out."""
        grid = self.grid
        height_m = averaged(self.height_m, cells)
        coarse = Grid(grid.west_m, grid.north_m, cells * grid.cell_m, (height_m.shape[0], height_m.shape[1]))
        return Terrain(coarse, height_m, np.full((*height_m.shape, 3), np.nan, np.float32))

    def triangles_of(self, mesh: SiteMesh) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Row, column and square meters (n,) of a mesh's triangles over, and below, the cells."""
        column, row = np.rint(self.grid.pixels(mesh.triangle_centers_m)).astype(np.int64).T
        height, width = self.grid.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        return row[inside], column[inside], mesh.triangle_areas_m2[inside]


def averaged(heights: NDArray[np.float64], cells: int) -> NDArray[np.float64]:
    """Means of blocks of cells x cells of heights (H, W), NaN where less than half of one is known."""
    if cells == 1:
        return heights
    rows, columns = (n // cells for n in heights.shape)
    blocks = heights[: rows * cells, : columns * cells].reshape(rows, cells, columns, cells)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0).sum(axis=(1, 3))
    return np.where(count >= 0.5 * cells**2, total / np.maximum(count, 1), np.nan)


def grid_of(mesh: SiteMesh, cell_m: float) -> Grid:
    """The cells that cover a mesh."""
    return Grid.around(mesh.points_m.min(axis=0), mesh.points_m.max(axis=0), cell_m)


def terrain_of(mesh: SiteMesh, grid: Grid) -> Terrain:
    """A mesh on a grid."""
    height = np.full(grid.shape, np.nan)
    color = np.full((*grid.shape, 3), np.nan, np.float32)
    pixels = np.concatenate([grid.pixels(mesh.points_m), mesh.points_m[:, 2:]], axis=1)
    rasterize(pixels, mesh.color.astype(np.float32), mesh.triangles, height, color)
    return Terrain(grid, height, color)
