"""Triangles of a tile's voxels by Open3D."""

from typing import Any

import numba
import numpy as np

from stereo_seecolor.errors import DeviceError
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.volume import MIN_WEIGHT, Triangles, Volume

LIBRARIES = "apt-get install -y libusb-1.0-0 libgl1 libgomp1 libegl1"


def extract(volume: Volume) -> Triangles | None:
    """The triangles where the signed distance is zero and all eight voxels around have weight; None where there are none."""
    o3d = open3d()
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


def open3d() -> Any:
    """The library. Raises DeviceError, with the command that installs what is missing."""
    numba.set_num_threads(numba.get_num_threads())  # starts numba's threads, which would stumble over Open3D's older TBB
    try:
        import open3d as library
    except ModuleNotFoundError as error:
        raise DeviceError(f"a window onto the map needs Open3D, which is not installed ({error}): pip install open3d") from error
    except (ImportError, OSError) as error:
        raise DeviceError(f"a window onto the map needs Open3D, which lacks a system library ({error}): {LIBRARIES}") from error
    return library
