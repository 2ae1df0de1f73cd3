"""A gray picture of the bottom from above, fine enough to recognize things: the orthomosaic, or the
mesh's colors without one.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.rasters import open_raster
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.terrain import Terrain
from stereo_seecolor.run_folder.layout import MOSAIC
from stereo_seecolor.run_folder.posed_run import PosedRun

FINEST_OF_VOXEL = 0.25
"""Cells of the picture, in voxels: what is finer is grain that the next dive sees otherwise."""
MOST_PX = 36e6
"""Some 20 s and 2 GB of SIFT; larger sites are examined in coarser cells."""


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """A gray picture. gray: (H, W) uint8, 0 where nothing is known. grid: of its pixels, in the
    map's own coordinates.
    """

    gray: NDArray[np.uint8]
    grid: Grid


def orthophoto(posed: PosedRun, terrain: Terrain) -> Orthophoto:
    """Make the gray picture of a fused run. Raises InputError if its orthomosaic is damaged."""
    path = posed.map_folder / MOSAIC
    if not georeference.available() or not path.is_file():
        return Orthophoto(_gray(np.nan_to_num(terrain.color), terrain.known), terrain.grid)
    from rasterio.enums import Resampling

    with open_raster(path, 4) as file:
        cell_m, corner = (
            file.res[0],
            (file.bounds.left - posed.offset_m[0], file.bounds.top - posed.offset_m[1]),
        )
        step = max(
            FINEST_OF_VOXEL * posed.voxel_m / cell_m,
            float(np.sqrt(file.width * file.height / MOST_PX)),
            1.0,
        )
        shape = max(int(file.height / step), 1), max(int(file.width / step), 1)
        bands = file.read([1, 2, 3, 4], out_shape=(4, *shape), resampling=Resampling.average)
        grid = Grid(corner[0], corner[1], cell_m * file.width / shape[1], shape)
    return Orthophoto(_gray(np.moveaxis(bands[:3], 0, -1), bands[3] > 127), grid)


def _gray(color: NDArray[np.generic], known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    gray = cv2.cvtColor(color.clip(1, 255).astype(np.uint8), cv2.COLOR_RGB2GRAY)
    return np.where(known, np.maximum(gray, 1), 0).astype(np.uint8)
