"""A pair's colored points, from its range map straight to the content of a PLY file."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Image, Map

VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])


def encode_cloud(range_m: Map, rays: NDArray[np.float32], rgb: Image) -> memoryview:
    """A binary little-endian PLY of the pixels with a known range: float32 x y z in meters, uchar red green blue.

    range_m: (H, W), unknown where not finite. rays: (H, W, 3) unit vectors. rgb: (H, W, 3), of 16 bits the upper 8 are kept.
    """
    points = int(np.count_nonzero(np.isfinite(range_m)))
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment stereo-seecolor, meters, left rectified camera: x right, y down, z forward\n"
        f"element vertex {points}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    ).encode("ascii")
    content = np.empty(len(header) + points * VERTEX.itemsize, np.uint8)
    content[: len(header)] = np.frombuffer(header, np.uint8)
    vertices = content[len(header) :].view(VERTEX)
    _fill(range_m, rays, rgb, np.uint8(8 * (rgb.dtype.itemsize - 1)), vertices["xyz"], vertices["rgb"])
    return content.data


@compiled
def _fill(range_m, rays, rgb, shift, xyz, colors):  # type: ignore[no-untyped-def]  # pragma: no cover
    n = 0
    for row in range(range_m.shape[0]):
        for column in range(range_m.shape[1]):
            meters = range_m[row, column]
            if np.isfinite(meters):
                for i in range(3):
                    xyz[n, i] = rays[row, column, i] * meters
                    colors[n, i] = rgb[row, column, i] >> shift
                n += 1
