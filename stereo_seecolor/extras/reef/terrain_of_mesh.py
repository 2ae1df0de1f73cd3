"""Terrain of a mesh: heights and colors seen from straight above, on a grid."""

import numpy as np

from stereo_seecolor.extras.reef.site_surface import SiteMesh
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_model import Terrain
from stereo_seecolor.mapping.raster.rasterize import rasterize


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
