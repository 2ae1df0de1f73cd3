"""The cell size of an orthomosaic where the settings leave it open."""

from dataclasses import dataclass

import numpy as np

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.tiles import Tiling
from stereo_seecolor.mapping.voxel_size import rounded


@dataclass(frozen=True)
class MosaicCellSettings:
    """How the cell size is chosen."""

    # of the ground that was seen: a minute's work on two cores, 4000 x 4000 on a screen
    cells: float = 16e6


SETTINGS = MosaicCellSettings()


def with_mosaic_cell(config: MappingConfig, component: Component, tiling: Tiling) -> MappingConfig:
    """Set ``mosaic_m`` where it is not set: a pixel at the images' median depth, or coarser where
    the area is large.

    Half a voxel is fine enough for a large area; cells finer than the images' pixels hold nothing.
    """
    if config.mosaic_m:
        return config
    points_m = (component.survey.index.points_m[int(i)] for i in component.frames)
    depths_m = [np.median(own[:, 2]) for own in points_m if len(own)]
    if not depths_m:
        return config
    pixel_m = float(np.median(depths_m)) / component.survey.geometry.focal_px
    area_m2 = tiling.columns * (BLOCK * tiling.voxel_m) ** 2
    cell_m = max(pixel_m, min(float(np.sqrt(area_m2 / SETTINGS.cells)), config.mosaic_cell_m))
    return config.model_copy(update={"mosaic_m": rounded(cell_m)})
