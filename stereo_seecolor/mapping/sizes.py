"""Sizes of a map's voxels and of its mosaic's cells, where the settings leave them open."""

from dataclasses import dataclass

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.tiles import Tiling
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame


@dataclass(frozen=True)
class SizeSettings:
    """How the sizes are chosen."""

    # voxels: edge, in pixels on the bottom: a range is matched over some five, finer voxels hold
    # only noise
    pixels: float = 5.0
    frames: int = 9  # examined, spread over the dive: their median range decides
    sample_step: int = 16  # pixels
    # sizes are round, so that repeated surveys share their voxels and cells
    steps: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0)
    # of a mosaic, of the ground that was seen: a minute's work on two cores, 4000 x 4000 on a
    # screen
    cells: float = 16e6


SETTINGS = SizeSettings()


def with_voxel(config: MappingConfig, frames: Frames, geometry: RectifiedPair) -> MappingConfig:
    """Set ``voxel_m`` where it is not set: five pixels at the median range, rounded to 1, 2 or 5
    times a power of ten.
    """
    if config.voxel_m:
        return config
    step = max(1, -(-len(frames) // SETTINGS.frames))
    ranges_m = [
        range_m
        for number in range(0, len(frames), step)
        if np.isfinite(range_m := _typical_range_m(frames[number]))
    ]
    if not ranges_m:
        return config
    return config.model_copy(
        update={
            "voxel_m": rounded(SETTINGS.pixels * float(np.median(ranges_m)) / geometry.focal_px)
        }
    )


def _typical_range_m(frame: SurveyFrame | Unplaced) -> float:
    """The median of a frame's ranges; NaN where it has none."""
    if isinstance(frame, Unplaced):
        return float("nan")
    sample = frame.range_m[:: SETTINGS.sample_step, :: SETTINGS.sample_step]
    known = sample[np.isfinite(sample)]
    return float(np.median(known)) if known.size else float("nan")


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


def rounded(size: float) -> float:
    """Round to the nearest of 1, 2, 5 times a power of ten."""
    decade = int(np.floor(np.log10(size)))
    nearest = min(SETTINGS.steps, key=lambda step: abs(float(np.log(step * 10.0**decade / size))))
    return float(f"{nearest:g}e{decade}")
