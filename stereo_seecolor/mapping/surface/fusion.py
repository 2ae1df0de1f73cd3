"""A tile's frames into a surface: our weights fill the voxels, an extractor finds the triangles."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.surface.extraction import extract
from stereo_seecolor.mapping.surface.kernels import colors_at, integrate, packed, weigh
from stereo_seecolor.mapping.surface.surface import Surface, only_used
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, Tiling
from stereo_seecolor.mapping.surface.volume import Triangles, Volume
from stereo_seecolor.records import SurveyFrame

PlacedFrame = tuple[SurveyFrame, NDArray[np.float64]]
"""A frame and its T_world_camera."""


def fuse_tile(tile: Tile, tiling: Tiling, frames: Iterable[PlacedFrame], geometry: RectifiedPair) -> Surface:
    """Integrate frames into the tile and extract the triangles that belong to it alone; an empty tile is empty."""
    volume = Volume.empty(tile.blocks, tiling.voxel_m)
    for frame, T_world_camera in frames:
        _integrate(volume, frame, T_world_camera, geometry)
    triangles = extract(volume)
    if triangles is None:
        return Surface.empty()
    surface = _cut_to_tile(triangles, tile, tiling)
    keys = packed(*tile.blocks.T.astype(np.int64))
    order = np.argsort(keys)
    colored = colors_at(surface.points_m.astype(np.float64), keys[order], order, volume.color, volume.color_weight, tiling.voxel_m)
    return replace(surface, colors=np.clip(np.rint(colored), 0, 255).astype(np.uint8))


def _integrate(volume: Volume, frame: SurveyFrame, T_world_camera: NDArray[np.float64], geometry: RectifiedPair) -> None:
    depth_m, pixel_weight = np.empty(frame.range_m.shape, np.float32), np.empty(frame.range_m.shape, np.float32)
    farthest_m = weigh(
        frame.range_m, frame.range_std_m, frame.confidence, geometry.ray_length, volume.voxel_m, depth_m, pixel_weight
    )
    integrate(
        volume.blocks,
        volume.tsdf,
        volume.weight,
        volume.color,
        volume.color_weight,
        frame.color,
        frame.color_is_doubtful,
        depth_m,
        pixel_weight,
        np.array([geometry.focal_px, geometry.cx_left_px, geometry.cy_px, farthest_m]),
        inverse(T_world_camera),
        volume.voxel_m,
        TRUNCATION_VOXELS * volume.voxel_m,
    )


def _cut_to_tile(found: Triangles, tile: Tile, tiling: Tiling) -> Surface:
    """Keep the triangles whose center lies in the tile: each belongs to one tile, whichever extracted it."""
    own = _owned(found, tile, tiling)
    used, triangles = only_used(found.indices[own], len(found.points_m))
    no_colors = np.zeros((len(used), 3), np.uint8)
    return _in_order(Surface(found.points_m[used], found.normals[used], no_colors, triangles))


def _owned(found: Triangles, tile: Tile, tiling: Tiling) -> NDArray[np.bool_]:
    """(T,) which triangles' centers lie in the tile; added up from the least, so that it is the same in whichever order."""
    a, b, c = np.moveaxis(found.points_m[:, :2].astype(np.float64)[found.indices], 1, 0)
    low, high = np.minimum(a, b), np.maximum(a, b)
    centers = (np.minimum(low, c) + np.maximum(low, np.minimum(high, c)) + np.maximum(high, c)) / 3
    return np.asarray((np.floor(centers / tiling.tile_m) == tile.column).all(axis=1))


def _in_order(surface: Surface) -> Surface:
    """Points and triangles sorted: Open3D's threads number them anew on each run."""
    order = np.lexsort(surface.points_m.T)
    numbers = np.empty(len(order), np.int32)
    numbers[order] = np.arange(len(order), dtype=np.int32)
    triangles = numbers[surface.triangles]
    first = triangles.argmin(axis=1)[:, None] if len(triangles) else np.zeros((0, 1), np.int64)
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    pairs = triangles[:, 0].astype(np.int64) << 32 | triangles[:, 1]
    triangles = triangles[np.lexsort((triangles[:, 2], pairs))]
    return Surface(surface.points_m[order], surface.normals[order], surface.colors[order], triangles)
