"""Fusion of a tile by Open3D (``mapping.engine: open3d``): its VoxelBlockGrid for our voxels.

It weighs all measurements alike, so those too uncertain to make a surface in a single view are left
out. Imported only where it is chosen; the import fails with the command that installs Open3D.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.transforms import inverse
from stereo_seecolor.mapping.surface.extraction import MIN_WEIGHT
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.open3d_library import open3d
from stereo_seecolor.mapping.surface.own_engine import PlacedFrame
from stereo_seecolor.mapping.surface.surface import Surface, only_used
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, Tiling
from stereo_seecolor.records import SurveyFrame

LIBRARY = open3d("mapping.engine: open3d")
MAX_STD_VOXELS = float(np.sqrt(1 / MIN_WEIGHT))
FARTHEST_DEPTH_M = 1000.0
"""Open3D must be given a farthest depth; frames hold none beyond matching.max_range_m."""


def fuse_tile(
    tile: Tile, tiling: Tiling, frames: Iterable[PlacedFrame], geometry: RectifiedPair
) -> Surface:
    """Integrate the frames into a grid of the tile's blocks, and extract the triangles that belong
    to this tile and not to its rim.

    The same frames give the same surface to the byte, as our own engine does.
    """
    core, voxel_m = LIBRARY.core, tiling.voxel_m
    attributes = ("tsdf", "weight", "color"), (core.float32,) * 3, ((1,), (1,), (3,))
    grid = LIBRARY.t.geometry.VoxelBlockGrid(
        *attributes, voxel_m, BLOCK, len(tile.blocks) + 1, core.Device("CPU:0")
    )
    K = core.Tensor(np.ascontiguousarray(geometry.P_left[:, :3], np.float64))
    for frame, T_world_camera in frames:
        depth_m = _certain_depth_m(frame, geometry, voxel_m)
        T_camera_world = inverse(T_world_camera)
        blocks = tile.blocks[
            _in_view(tile.blocks, T_camera_world, geometry, voxel_m, float(depth_m.max()))
        ]
        if len(blocks):
            images = (
                LIBRARY.t.geometry.Image(core.Tensor(image))
                for image in (depth_m, frame.color.astype(np.float32))
            )
            T = core.Tensor(np.ascontiguousarray(T_camera_world))
            grid.integrate(
                core.Tensor(np.ascontiguousarray(blocks)),
                *images,
                K,
                K,
                T,
                1.0,
                FARTHEST_DEPTH_M,
                float(TRUNCATION_VOXELS),
            )
    if not grid.hashmap().size():
        return Surface.empty()
    mesh = grid.extract_triangle_mesh(weight_threshold=0.0)
    return _own_part(mesh, tile, tiling) if "positions" in mesh.vertex else Surface.empty()


def _certain_depth_m(
    frame: SurveyFrame, geometry: RectifiedPair, voxel_m: float
) -> NDArray[np.float32]:
    """Depths (H, W), 0 where none is known or it is too uncertain."""
    known = (
        (frame.range_m > 0)
        & (frame.confidence > 0)
        & ~(frame.range_std_m > MAX_STD_VOXELS * voxel_m)
    )
    return np.where(known, frame.range_m / geometry.ray_length, 0).astype(np.float32)


def _in_view(
    blocks: NDArray[np.int32],
    T_camera_world: NDArray[np.float64],
    geometry: RectifiedPair,
    voxel_m: float,
    deepest_m: float,
) -> NDArray[np.bool_]:
    """Which blocks' enclosing spheres meet the view, no deeper than the truncation behind the
    deepest measurement: (B,) bool.

    Open3D works on all blocks that it is given: also on those in front of the surface, where free
    space is measured.
    """
    x, y, z = (
        ((blocks + 0.5) * BLOCK * voxel_m) @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    ).T
    radius_m = np.sqrt(0.75) * BLOCK * voxel_m
    width, height = geometry.image_size
    f = geometry.focal_px
    near_m = np.maximum(z, 2 * radius_m)
    u = f * x / near_m + geometry.cx_left_px
    v = f * y / near_m + geometry.cy_px
    margin_px = f * radius_m / (near_m - radius_m)
    inside = (
        (u > -margin_px) & (u < width + margin_px) & (v > -margin_px) & (v < height + margin_px)
    )
    seen = (
        (z > -radius_m)
        & (inside | (z < 2 * radius_m))
        & (z - radius_m < deepest_m + TRUNCATION_VOXELS * voxel_m)
    )
    return np.asarray(seen & (deepest_m > 0))


def _own_part(mesh: Any, tile: Tile, tiling: Tiling) -> Surface:
    """The triangles of a mesh in the tile's column, in an order independent of threads."""
    # -0.0 is 0.0, as in the neighboring tile
    points = mesh.vertex.positions.numpy() + np.float32(0)
    triangles = mesh.triangle.indices.numpy()
    column = np.floor(points[triangles].mean(axis=1, dtype=np.float64)[:, :2] / tiling.tile_m)
    chosen, triangles = only_used(triangles[(column == tile.column).all(axis=1)], len(points))
    points = points[chosen]
    normals = mesh.vertex.normals.numpy()[chosen]
    colors = mesh.vertex.colors.numpy()[chosen]
    order, numbers = _distinct(points, np.concatenate([normals, colors], axis=1))
    whole = np.rint(np.clip(colors[order], 0, 255)).astype(np.uint8)
    return Surface(points[order], normals[order], whole, _ordered(numbers[triangles]))


def _distinct(
    points: NDArray[np.float32], other: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """One of each group of coincident points, as edges that meet in a corner of a voxel give them,
    sorted: their positions, and of all points (V, 3) the number of their group (V,). other: (V, k)
    values that decide which one is taken.
    """
    order = np.lexsort(points.T)
    is_first = np.append(True, (points[order][1:] != points[order][:-1]).any(axis=1))[: len(points)]
    if not is_first.all():
        order = np.lexsort((*other.T, *points.T))
    numbers = np.empty(len(points), np.int32)
    numbers[order] = np.cumsum(is_first) - 1
    return order[is_first], numbers


def _ordered(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Triangles (T, 3) of three points each, with the lowest number first, sorted."""
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    turned = np.take_along_axis(
        triangles, (triangles.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1
    )
    return np.ascontiguousarray(turned[np.lexsort(turned.T[::-1])])
