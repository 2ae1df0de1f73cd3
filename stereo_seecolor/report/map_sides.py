"""Which steps of a map's terrain have their sides in the mesh, for the page, tile by tile."""

from collections.abc import Sequence

import numpy as np

from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.mapping.raster.grid import widened
from stereo_seecolor.mapping.raster.sides import area_over, sides_seen, step_m
from stereo_seecolor.report.map_images import Box, TerrainImages
from stereo_seecolor.report.mesh_levels import MeshSource

MARGIN_CELLS = 2
"""A cell is judged by the cells around it, and these by their neighbors."""


def packed_sides(
    terrain: TerrainImages, box: Box, mesh: MeshSource, offset_m: Sequence[float], std_m: float
) -> dict[str, bytes]:
    """What a tile of heights gets beside them: a bit for each cell; nothing where no sides are.

    box: left, top, width and height of the tile. offset_m: of the map's own coordinates, which are
    the mesh's, in its world. std_m: of a height.
    """
    left, top, width, height = box
    window = slice(top, top + height), slice(left, left + width)
    (rows, columns), inner = widened(window, MARGIN_CELLS, MARGIN_CELLS, terrain.grid.shape)
    grid = terrain.grid.moved(-np.array(offset_m)).window(rows, columns)
    cell_m = grid.cell_m
    low_m = np.array([grid.west_m, grid.north_m - (grid.shape[0] + 1) * cell_m])
    high_m = np.array([grid.west_m + (grid.shape[1] + 1) * cell_m, grid.north_m + cell_m])
    part = mesh.within(low_m - cell_m, high_m)
    mesh_m2 = area_over(part.points_m, part.triangles, grid)
    around = columns.start, rows.start, *grid.shape[::-1]
    heights = terrain.heights_m(around).astype(np.float64)
    sides = sides_seen(heights, mesh_m2, cell_m, step_m(cell_m, std_m))[inner]
    return {"sides": deflated(np.packbits(sides).tobytes(), repeats=True)} if sides.any() else {}
