"""A tile's frames into a surface: weighted measurements fill the voxels, whose zero crossings are its points."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.surface.extraction import PART_BLOCKS, extract
from stereo_seecolor.mapping.surface.kernels import cells_of, in_sight, integrate
from stereo_seecolor.mapping.surface.measured_pixels import MeasuredPixels
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, Tiling
from stereo_seecolor.mapping.surface.volume import Volume
from stereo_seecolor.records import SurveyFrame

PlacedFrame = tuple[SurveyFrame, NDArray[np.float64]]
"""A frame and its T_world_camera."""


def fuse_tile(tile: Tile, tiling: Tiling, frames: Iterable[PlacedFrame], geometry: RectifiedPair) -> Surface:
    """Integrate frames into the tile and extract the triangles that belong to it alone; an empty tile is empty."""
    volume, measured = Volume.empty(tile.blocks, tiling.voxel_m), MeasuredPixels.room(geometry)
    for frame, T_world_camera in frames:
        _integrate(volume, measured, frame, inverse(T_world_camera))
    return extract(volume, np.flatnonzero((tile.blocks[:, :2] // tiling.tile_blocks == tile.column).all(axis=1)))


def _integrate(volume: Volume, measured: MeasuredPixels, frame: SurveyFrame, T_camera_world: NDArray[np.float64]) -> None:
    where = measured.camera, T_camera_world, volume.voxel_m
    measured.look(frame, cells_of(volume.blocks, measured.deepest_m.shape, *where), volume.voxel_m)
    truncation_m = TRUNCATION_VOXELS * volume.voxel_m
    chosen = in_sight(volume.blocks, measured.deepest_m, *where, truncation_m)
    voxels = volume.blocks, volume.tsdf, volume.weight, volume.color, volume.color_weight
    seen = frame.color, frame.color_is_doubtful, measured.depth_m, measured.weight, measured.stretch
    in_parts(lambda a, b: integrate(*voxels, *seen, *where, truncation_m, chosen, a, b), len(chosen), PART_BLOCKS)
