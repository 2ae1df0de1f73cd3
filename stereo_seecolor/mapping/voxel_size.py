"""The voxel size of a map where the settings leave it open."""

from dataclasses import dataclass

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame


@dataclass(frozen=True)
class VoxelSettings:
    """How the voxel size is chosen."""

    # edge, in pixels on the bottom: a range is matched over some five, finer voxels hold only noise
    pixels: float = 5.0
    frames: int = 9  # examined, spread over the dive: their median range decides
    sample_step: int = 16  # pixels
    # sizes are round, so that repeated surveys share their voxels and cells
    steps: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0)


SETTINGS = VoxelSettings()


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


def rounded(size: float) -> float:
    """Round to the nearest of 1, 2, 5 times a power of ten."""
    decade = int(np.floor(np.log10(size)))
    nearest = min(SETTINGS.steps, key=lambda step: abs(float(np.log(step * 10.0**decade / size))))
    return float(f"{nearest:g}e{decade}")
