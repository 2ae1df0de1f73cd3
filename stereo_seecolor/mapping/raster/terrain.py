"""The terrain: height of the highest surface over a grid's cells, color, standard error."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.noise import averaged
from stereo_seecolor.mapping.raster.rasterize import rasterize
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.records import Array


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
        """The terrain in cells so many times as wide, without colors or incomplete cells."""
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


def render_terrain(surfaces: Iterable[Surface], grid: Grid, folder: Path) -> BlockRaster:
    """Render the heights of the surfaces: (1, H, W) float32 meters, NaN where nothing was seen."""
    terrain = BlockRaster(folder, grid, 1, np.float32, np.nan)
    for surface in surfaces:
        if not len(surface.triangles):
            continue
        pixels = grid.pixels(surface.points_m)
        low = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, grid.shape[::-1])
        rows, columns = slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
        heights = terrain.read(rows, columns)
        points = np.concatenate([pixels - low, surface.points_m[:, 2:]], axis=1).astype(np.float64)
        no_colors = np.zeros((len(points), 0), np.float32)
        rasterize(
            points,
            no_colors,
            surface.triangles,
            heights[0],
            np.zeros((*heights.shape[1:], 0), np.float32),
        )
        terrain.write(rows, columns, heights)
    return terrain


def known_area_m2(blocks: Iterable[NDArray[np.floating]], cell_m: float) -> float:
    """The planar area that a map shows: of all cells of its terrain that have a height. blocks: of
    heights, NaN where unknown.
    """
    return sum(int(np.isfinite(heights).sum()) for heights in blocks) * cell_m**2
