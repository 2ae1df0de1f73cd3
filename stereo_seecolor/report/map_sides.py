"""Which steps of a map's terrain have their sides in the mesh, for the page, tile by tile."""

from collections.abc import Sequence

import numpy as np

from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.mapping.raster.grid import Grid
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
    about, (left, top, width, height) = terrain.about, box
    west, north = min(left, MARGIN_CELLS), min(top, MARGIN_CELLS)
    east = min(about["width"] - left - width, MARGIN_CELLS)
    south = min(about["height"] - top - height, MARGIN_CELLS)
    wider = left - west, top - north, width + west + east, height + north + south
    heights, cell_m = terrain.heights_m(wider).astype(np.float64), about["pixel_m"]
    west_m = about["west_m"] + wider[0] * cell_m - offset_m[0]
    north_m = about["north_m"] - wider[1] * cell_m - offset_m[1]
    grid = Grid(west_m, north_m, cell_m, (wider[3], wider[2]))
    low_m = np.array([west_m, north_m - (wider[3] + 1) * cell_m])
    high_m = np.array([west_m + (wider[2] + 1) * cell_m, north_m + cell_m])
    part = mesh.within(low_m - cell_m, high_m)
    mesh_m2 = area_over(part.points_m, part.triangles, grid)
    sides = sides_seen(heights, mesh_m2, cell_m, step_m(cell_m, std_m))
    sides = sides[north : north + height, west : west + width]
    return {"sides": deflated(np.packbits(sides).tobytes(), repeats=True)} if sides.any() else {}
