"""The terrain model: the height of the highest fused surface over each cell."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.rasterize import rasterize
from stereo_seecolor.mapping.surface.surface import Surface


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
