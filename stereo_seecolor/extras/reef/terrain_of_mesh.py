"""Terrain of a mesh: heights and colors from straight above, on a grid, and their errors."""

import numpy as np

from stereo_seecolor.extras.reef.site_surface import SiteMesh
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.rasterize import rasterize
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import Array
from stereo_seecolor.report.terrain_views import correlation_of, noise_of, views_of
from stereo_seecolor.run_folder.posed_run import PosedRun


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


def terrain_errors(
    posed: PosedRun, terrain: Terrain, T_terrain_map: Array | None = None
) -> TerrainErrors:
    """The standard errors of the terrain of a run. T_terrain_map: (4, 4), where the terrain is not
    in the map's own coordinates.

    Where views differ by more than their standard errors say, the mean's is widened by the Birge
    ratio (Birge 1932, Phys. Rev. 40). At rims all views are wrong alike, which height_stds of
    mapping/raster/height_errors.py adds.
    Raises InputError if the run, or a frame of the map, cannot be read.
    """
    T = np.eye(4) if T_terrain_map is None else T_terrain_map
    shape = terrain.grid.shape
    weight, square, mean = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    views, footprints_m = np.zeros(shape, np.int32), list[float]()
    heights = terrain.height_m
    for view in views_of(posed, posed.survey, terrain.grid, lambda window: heights[window], T):
        weight[view.window] += view.weight
        mean[view.window] += view.weight * view.off_m
        square[view.window] += view.weight * view.off_m**2
        views[view.window] += view.seen
        if view.seen.any():
            footprints_m.append(view.footprint_m)
    known = views > 0
    spread = np.maximum(square - mean**2 / np.where(known, weight, 1), 0)
    birge = np.maximum(spread / np.maximum(views - 1, 1), 1)
    noise_m = noise_of(weight, terrain.known)
    return TerrainErrors(
        noise_m * np.sqrt(birge), noise_m, views, correlation_of(footprints_m, terrain.grid)
    )
