"""How large the cells of an orthomosaic are where the settings leave it open."""

from dataclasses import dataclass

import numpy as np

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.tiles import Tiling


@dataclass(frozen=True)
class MosaicCellSettings:
    """How fine is sensible."""

    cells: float = 16e6  # of the ground that was seen: a minute's work on two cores, 4000 x 4000 on a screen
    steps: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0)  # sizes are round, so that repeated surveys share their cells


SETTINGS = MosaicCellSettings()


def with_mosaic_cell(config: MappingConfig, component: Component, tiling: Tiling) -> MappingConfig:
    """The settings with ``mosaic_m`` set: a pixel at the images' median depth, or coarser where the area is large.

    Half a voxel is fine enough for a large area; cells finer than the images' pixels hold nothing.
    """
    points = [component.survey.index.points_m[i] for i in component.frames if len(component.survey.index.points_m[i])]
    if config.mosaic_m or not points:
        return config
    pixel_m = float(np.median([np.median(own[:, 2]) for own in points])) / component.survey.geometry.focal_px
    area_m2 = tiling.columns * (BLOCK * tiling.voxel_m) ** 2
    cell_m = max(pixel_m, min(float(np.sqrt(area_m2 / SETTINGS.cells)), config.mosaic_cell_m))
    return config.model_copy(update={"mosaic_m": _rounded(cell_m)})


def _rounded(size: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten."""
    decade = int(np.floor(np.log10(size)))
    nearest = min(SETTINGS.steps, key=lambda step: abs(float(np.log(step * 10.0**decade / size))))
    return float(f"{nearest:g}e{decade}")
