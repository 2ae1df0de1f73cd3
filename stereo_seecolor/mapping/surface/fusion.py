"""A tile's frames into a surface: weighted measurements fill the voxels, whose zero crossings are its points."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.surface.extraction import PART_BLOCKS, extract
from stereo_seecolor.mapping.surface.kernels import CELL, in_sight, integrate, weigh
from stereo_seecolor.mapping.surface.slant import stretches
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, Tiling
from stereo_seecolor.mapping.surface.volume import Volume
from stereo_seecolor.records import SurveyFrame

PlacedFrame = tuple[SurveyFrame, NDArray[np.float64]]
"""A frame and its T_world_camera."""


def fuse_tile(tile: Tile, tiling: Tiling, frames: Iterable[PlacedFrame], geometry: RectifiedPair) -> Surface:
    """Integrate frames into the tile and extract the triangles that belong to it alone; an empty tile is empty."""
    volume = Volume.empty(tile.blocks, tiling.voxel_m)
    for frame, T_world_camera in frames:
        _integrate(volume, frame, T_world_camera, geometry)
    return extract(volume, np.flatnonzero((tile.blocks[:, :2] // tiling.tile_blocks == tile.column).all(axis=1)))


def _integrate(volume: Volume, frame: SurveyFrame, T_world_camera: NDArray[np.float64], geometry: RectifiedPair) -> None:
    height, width = frame.range_m.shape
    depth_m, pixel_weight, stretch = (np.empty((height, width), np.float32) for _ in range(3))
    deepest_m = np.empty((-(-height // CELL), -(-width // CELL)), np.float32)
    measured = frame.range_m, frame.range_std_m, frame.confidence, geometry.ray_length, volume.voxel_m
    in_parts(lambda a, b: weigh(*measured, depth_m, pixel_weight, deepest_m, a, b), len(deepest_m))
    camera = np.array([geometry.focal_px, geometry.cx_left_px, geometry.cy_px])
    in_parts(lambda a, b: stretches(depth_m, pixel_weight, camera, stretch, a, b), height)
    where = camera, inverse(T_world_camera), volume.voxel_m, TRUNCATION_VOXELS * volume.voxel_m
    chosen = in_sight(volume.blocks, deepest_m, *where)
    voxels = volume.blocks, volume.tsdf, volume.weight, volume.color, volume.color_weight
    seen = frame.color, frame.color_is_doubtful, depth_m, pixel_weight, stretch
    in_parts(lambda a, b: integrate(*voxels, *seen, *where, chosen, a, b), len(chosen), PART_BLOCKS)
