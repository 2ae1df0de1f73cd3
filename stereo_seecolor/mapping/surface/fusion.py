"""A tile's frames into a surface: Open3D's voxel block grid holds and meshes it, our weights fill it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.surface.kernels import BLOCK, colors_at, integrate, packed
from stereo_seecolor.mapping.surface.tiles import TRUNCATION_VOXELS, Tile, Tiling
from stereo_seecolor.records import SurveyFrame

MIN_WEIGHT = 0.05
"""A surface is kept where the weights add up to this: a standard error of some four voxels, seen once."""

LIBRARIES = "apt-get install -y libusb-1.0-0 libgl1 libgomp1 libegl1"


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh. points_m, normals: (V, 3) float32; colors: (V, 3) uint8; triangles: (T, 3) int32."""

    points_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    colors: NDArray[np.uint8]
    triangles: NDArray[np.int32]

    @classmethod
    def empty(cls) -> "Surface":
        """No points."""
        none = np.zeros((0, 3), np.float32)
        return cls(none, none, np.zeros((0, 3), np.uint8), np.zeros((0, 3), np.int32))


def check_available() -> None:
    """Raise DeviceError, with the command that mends it, where Open3D cannot be imported; call before the first frame."""
    _open3d()


def _open3d() -> Any:
    numba.set_num_threads(numba.get_num_threads())  # starts numba's threads, which would stumble over Open3D's older TBB
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise DeviceError(f"the map needs Open3D, which is not installed ({error}): pip install open3d") from error
    except (ImportError, OSError) as error:
        raise DeviceError(f"the map needs Open3D, which lacks a system library ({error}): {LIBRARIES}") from error
    return open3d


def fuse_tile(
    tile: Tile, tiling: Tiling, frames: Iterable[tuple[SurveyFrame, NDArray[np.float64]]], pair: RectifiedPair
) -> Surface:
    """Integrate frames (each with its T_world_camera) into the tile and extract the triangles that belong to it alone."""
    o3d = _open3d()
    grid, keys = _grid(o3d, tile, tiling.voxel_m)
    tsdf, weight = (grid.attribute(name).numpy()[: len(keys)] for name in ("tsdf", "weight"))
    color, color_weight = np.zeros((*weight.shape[:4], 3), np.float32), np.zeros(weight.shape[:4], np.float32)
    for frame, T_world_camera in frames:
        camera = np.array([pair.focal_px, pair.cx_left_px, pair.cy_px, _farthest(frame)])
        integrate(
            keys,
            tsdf[..., 0],
            weight[..., 0],
            color,
            color_weight,
            frame.color,
            frame.color_is_doubtful,
            frame.range_m,
            frame.range_std_m,
            frame.confidence,
            camera,
            inverse(T_world_camera),
            tiling.voxel_m,
            TRUNCATION_VOXELS * tiling.voxel_m,
        )
    if not (weight > MIN_WEIGHT).any():
        return Surface.empty()
    surface = _cut_to_tile(grid.extract_triangle_mesh(MIN_WEIGHT), tile, tiling)
    numbers = packed(*keys.T.astype(np.int64))
    order = np.argsort(numbers)
    colors = colors_at(surface.points_m.astype(np.float64), numbers[order], order, color, color_weight, tiling.voxel_m)
    return replace(surface, colors=np.clip(np.rint(colors), 0, 255).astype(np.uint8))


def _grid(o3d: Any, tile: Tile, voxel_m: float) -> tuple[Any, NDArray[np.int32]]:
    """A voxel block grid with all blocks of the tile, and their coordinates in the order of its buffers."""
    float32 = o3d.core.float32
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), (float32,) * 2, ((1), (1)), voxel_m, BLOCK, len(tile.blocks), o3d.core.Device("CPU:0")
    )
    buffers, _ = grid.hashmap().activate(o3d.core.Tensor(np.ascontiguousarray(tile.blocks)))
    keys = np.empty_like(tile.blocks)
    keys[buffers.numpy()] = tile.blocks
    return grid, keys


def _farthest(frame: SurveyFrame) -> float:
    known = frame.range_m[np.isfinite(frame.range_m)]
    return float(known.max()) if known.size else 0.0


def _cut_to_tile(mesh: Any, tile: Tile, tiling: Tiling) -> Surface:
    """Keep the triangles whose center lies in the tile: each belongs to one tile, whichever extracted it."""
    points = mesh.vertex.positions.numpy()
    triangles = mesh.triangle.indices.numpy()
    if not len(triangles):
        return Surface.empty()
    centers = np.sort(points[triangles][..., :2].astype(np.float64), axis=1).mean(axis=1)
    own = (np.floor(centers / tiling.tile_m) == tile.column).all(axis=1)
    used, renumbered = np.unique(triangles[own], return_inverse=True)
    normals, no_colors = mesh.vertex.normals.numpy()[used], np.zeros((len(used), 3), np.uint8)
    return _in_order(Surface(points[used], normals, no_colors, renumbered.reshape(-1, 3).astype(np.int32)))


def _in_order(surface: Surface) -> Surface:
    """Points and triangles sorted: Open3D's threads number them anew on each run."""
    order = np.lexsort(surface.points_m.T)
    numbers = np.empty(len(order), np.int32)
    numbers[order] = np.arange(len(order), dtype=np.int32)
    triangles = numbers[surface.triangles]
    first = triangles.argmin(axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    triangles = triangles[np.lexsort(triangles.T[::-1])]
    return Surface(surface.points_m[order], surface.normals[order], surface.colors[order], triangles)
