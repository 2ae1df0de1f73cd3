"""The surface in a tile's voxels, extracted by Open3D."""

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import DeviceError
from stereo_seecolor.mapping.surface.kernels import BLOCK

MIN_WEIGHT = 0.05
"""A surface is kept where the weights add up to this: a standard error of some four voxels, seen once."""
LIBRARIES = "apt-get install -y libusb-1.0-0 libgl1 libgomp1 libegl1"


@dataclass(frozen=True, eq=False)
class Volume:
    """A tile's voxels. blocks: (B, 3) int32 coordinates. tsdf: signed distance in units of the truncation; weight: its weight,
    both (B, 8, 8, 8) float32, index z, y, x. color: (B, 8, 8, 8, 3) float32, 0..255; color_weight: (B, 8, 8, 8) float32.
    """

    blocks: NDArray[np.int32]
    voxel_m: float
    tsdf: NDArray[np.float32]
    weight: NDArray[np.float32]
    color: NDArray[np.float32]
    color_weight: NDArray[np.float32]

    @classmethod
    def empty(cls, blocks: NDArray[np.int32], voxel_m: float) -> "Volume":
        """Nothing seen yet."""
        shape = (len(blocks), BLOCK, BLOCK, BLOCK)
        tsdf, weight, color_weight = (np.zeros(shape, np.float32) for _ in range(3))
        return cls(blocks, voxel_m, tsdf, weight, np.zeros((*shape, 3), np.float32), color_weight)


@dataclass(frozen=True, eq=False)
class Triangles:
    """points_m, normals: (V, 3) float32. indices: (T, 3) int64."""

    points_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    indices: NDArray[np.int64]


def check_available() -> None:
    """Raise DeviceError, with the command that mends it, where Open3D cannot be imported; call before the first frame."""
    _open3d()


def extract(volume: Volume) -> Triangles | None:
    """The triangles where the signed distance is zero and all eight voxels around have weight; None where there are none."""
    if not (volume.weight > MIN_WEIGHT).any():
        return None
    o3d = _open3d()
    float32 = o3d.core.float32
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), (float32,) * 2, ((1), (1)), volume.voxel_m, BLOCK, len(volume.blocks), o3d.core.Device("CPU:0")
    )
    buffers, _ = grid.hashmap().activate(o3d.core.Tensor(np.ascontiguousarray(volume.blocks)))
    for name, values in (("tsdf", volume.tsdf), ("weight", volume.weight)):
        grid.attribute(name).numpy()[buffers.numpy(), ..., 0] = values
    try:
        mesh = grid.extract_triangle_mesh(MIN_WEIGHT)
    except RuntimeError as error:
        if "shape {0}" in str(error):  # how Open3D says that there is no triangle
            return None
        raise
    indices = mesh.triangle.indices.numpy().astype(np.int64)
    return Triangles(mesh.vertex.positions.numpy(), mesh.vertex.normals.numpy(), indices) if len(indices) else None


def _open3d() -> Any:
    numba.set_num_threads(numba.get_num_threads())  # starts numba's threads, which would stumble over Open3D's older TBB
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise DeviceError(f"the map needs Open3D, which is not installed ({error}): pip install open3d") from error
    except (ImportError, OSError) as error:
        raise DeviceError(f"the map needs Open3D, which lacks a system library ({error}): {LIBRARIES}") from error
    return open3d
