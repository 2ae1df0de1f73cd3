"""Fusion of a tile: its frames' weighted measurements fill the voxels, and the surface is where
their signed distance is zero.
"""

from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.transforms import inverse
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.mapping.surface.extraction import PART_BLOCKS, Volume, extract
from stereo_seecolor.mapping.surface.kernels import cells_of, in_sight, integrate, windows_of
from stereo_seecolor.mapping.surface.measured_pixels import MeasuredPixels
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, Tiling
from stereo_seecolor.records import SurveyFrame

PlacedFrame = tuple[SurveyFrame, NDArray[np.float64]]
"""A frame and its T_world_camera."""


def fuse_tile(
    tile: Tile, tiling: Tiling, frames: Iterable[PlacedFrame], geometry: RectifiedPair
) -> Surface:
    """Integrate the frames into the tile's voxels, and extract the triangles that belong to this
    tile and not to its rim.

    The surface has no points where no frame measured anything.
    """
    volume, measured = Volume.empty(tile.blocks, tiling.voxel_m), MeasuredPixels.room(geometry)
    for frame, T_world_camera in frames:
        _integrate(volume, measured, frame, inverse(T_world_camera))
    is_own = (tile.blocks[:, :2] // tiling.tile_blocks == tile.column).all(axis=1)
    return extract(volume, np.flatnonzero(is_own))


def _integrate(
    volume: Volume,
    measured: MeasuredPixels,
    frame: SurveyFrame,
    T_camera_world: NDArray[np.float64],
) -> None:
    camera, voxel_m = measured.camera, volume.voxel_m
    truncation_m = TRUNCATION_VOXELS * voxel_m
    windows, nearest_m = windows_of(
        volume.blocks, measured.deepest_m.shape, camera, T_camera_world, voxel_m
    )
    measured.weigh(frame, cells_of(windows), voxel_m)
    seen = np.empty(len(windows), np.bool_)
    in_sight(windows, nearest_m, measured.deepest_m, truncation_m, seen)
    chosen = np.flatnonzero(seen)
    work = partial(
        integrate, volume.blocks, volume.tsdf, volume.weight, volume.color, volume.color_weight,
        frame.color, frame.color_is_doubtful, measured.depth_m, measured.weight,
        measured.slant_factor, camera, T_camera_world, voxel_m, truncation_m, chosen,
    )  # fmt: skip
    in_parts(work, len(chosen), PART_BLOCKS)
