"""Weighted TSDF integration of one frame into voxel blocks, on all cores."""

from typing import Any

import numpy as np
from numba import prange

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.color_weight import color_weight

BLOCK = 8
"""Voxels along the edge of a block."""

NEAREST_M = 0.05
"""Nearer than the cameras' housing nothing is measured, meters."""
BITS = 21
"""Of a block's coordinate in a packed number: three of them fit into 63."""
OFFSET = 1 << (BITS - 1)


@compiled
def weigh(
    range_m: Any,  # (H, W) float32
    range_std_m: Any,  # (H, W) float32
    confidence: Any,  # (H, W) float32
    ray_length: Any,  # (H, W) float: range over depth
    voxel_m: float,
    depth_m: Any,  # (H, W) float32, written
    weight: Any,  # (H, W) float32, written: 0 where nothing was measured
) -> float:
    """Depths and weights of a frame's pixels; the farthest range, 0 where there is none.

    Weight = confidence (voxel / standard error)^2. The error of stereo grows with the square of the range; without regard to
    that, one near fish would outweigh all that see through it.
    """
    farthest = 0.0
    for row in range(range_m.shape[0]):
        for column in range(range_m.shape[1]):
            measured, trust, std = range_m[row, column], confidence[row, column], range_std_m[row, column]
            weight[row, column] = 0
            if not (measured > 0 and trust > 0 and measured < np.inf):
                continue
            farthest = max(farthest, measured)
            depth_m[row, column] = measured / ray_length[row, column]
            weight[row, column] = trust * (voxel_m / std) ** 2 if std > 0 else trust
    return farthest


@compiled(parallel=True)
def integrate(
    keys: Any,  # (B, 3) int32 block coordinates
    tsdf: Any,  # (B, 8, 8, 8) float32 in units of the truncation, index z, y, x
    weight: Any,  # (B, 8, 8, 8) float32
    color: Any,  # (B, 8, 8, 8, 3) float32, 0..255
    color_weights: Any,  # (B, 8, 8, 8) float32
    rgb: Any,  # (H, W, 3) uint8
    doubtful: Any,  # (H, W) bool: its color counts next to nothing
    depth_m: Any,  # (H, W) float32, of ``weigh``
    pixel_weight: Any,  # (H, W) float32, of ``weigh``
    camera: Any,  # (4,) float64: focal_px, cx, cy, farthest range
    T: Any,  # (4, 4) float64, camera from world
    voxel_m: float,
    truncation_m: float,
) -> None:
    """Update every voxel that projects onto a measured pixel and does not lie deeper behind it than the truncation.

    Curless and Levoy's (1996) running weighted mean. Voxels in front of the surface are updated as well: that carves away what
    other frames saw only once, such as fish.
    """
    height, width = depth_m.shape
    for b in prange(keys.shape[0]):
        corner = np.array([keys[b, 0] * BLOCK * voxel_m, keys[b, 1] * BLOCK * voxel_m, keys[b, 2] * BLOCK * voxel_m])
        if _out_of_sight(corner, camera, T, width, height, voxel_m, truncation_m):
            continue
        for k, j in np.ndindex((BLOCK, BLOCK)):
            first = _in_camera(T, corner[0], corner[1] + j * voxel_m, corner[2] + k * voxel_m)
            for i in range(BLOCK):
                along = i * voxel_m
                z = first[2] + T[2, 0] * along
                if z <= NEAREST_M:
                    continue
                across, down = (first[0] + T[0, 0] * along) / z, (first[1] + T[1, 0] * along) / z
                u, v = camera[0] * across + camera[1] + 0.5, camera[0] * down + camera[2] + 0.5
                w = _at(pixel_weight, v, u)
                if w == 0:
                    continue
                row, column = np.uint64(v), np.uint64(u)
                # Compared by depth, which is the same all over a pixel that looks at level ground; range is not.
                measured, stretch = depth_m[row, column], np.sqrt(1 + across * across + down * down)
                signed = (measured - z) * stretch
                if signed < -truncation_m:
                    continue
                if signed > truncation_m:  # free space: as certain as a measurement at the voxel's own distance
                    w *= (measured / z) ** 4
                total = weight[b, k, j, i] + w
                value = min(1.0, signed / truncation_m)
                tsdf[b, k, j, i] += (value - tsdf[b, k, j, i]) * w / total
                weight[b, k, j, i] = total
                if signed <= truncation_m:
                    vertical = abs(T[0, 2] * across + T[1, 2] * down + T[2, 2]) / stretch
                    pixel_m = z * stretch / (camera[0] * max(vertical, 0.05))
                    w = color_weight(pixel_m / voxel_m, doubtful[row, column])
                    _mix(color[b, k, j, i], color_weights[b, k, j], i, rgb[row, column], w)


@compiled
def _at(image: Any, row: float, column: float) -> Any:
    """The value of the pixel there; 0 beside the image."""
    inside = row >= 0 and column >= 0 and row < image.shape[0] and column < image.shape[1]
    return image[np.uint64(row), np.uint64(column)] if inside else np.float32(0)


@compiled
def _in_camera(T: Any, x: float, y: float, z: float) -> Any:
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@compiled
def _out_of_sight(corner: Any, camera: Any, T: Any, width: int, height: int, voxel_m: float, truncation_m: float) -> bool:
    """True for a block whose enclosing sphere lies behind the camera, beyond the farthest range, or beside the image."""
    half, radius = BLOCK / 2 * voxel_m, 0.87 * BLOCK * voxel_m
    x, y, z = _in_camera(T, corner[0] + half, corner[1] + half, corner[2] + half)
    if z < -radius or z - radius > camera[3] + truncation_m:
        return True
    if z < 2 * radius:
        return False
    margin = 2 * camera[0] * radius / (z - radius)
    u, v = camera[0] * x / z + camera[1], camera[0] * y / z + camera[2]
    return bool(u < -margin or v < -margin or u > width + margin or v > height + margin)


@compiled
def _mix(color: Any, color_weights: Any, i: int, rgb: Any, w: float) -> None:
    """One more view of a voxel's color, into the running weighted mean."""
    color_weights[i] += w
    for c in range(3):
        color[c] += (rgb[c] - color[c]) * w / color_weights[i]


@compiled(parallel=True)
def colors_at(points_m: Any, sorted_keys: Any, order: Any, color: Any, color_weight: Any, voxel_m: float) -> Any:
    """(V, 3) float32 color of points, interpolated between the voxels around them that have one; NaN where none has.

    sorted_keys: (B,) int64 packed coordinates of the blocks; order: (B,) which block each is. color, color_weight: as in
    ``integrate``. A voxel that was only seen through has no color of its own, and must not darken its neighbors'.
    """
    result = np.full((len(points_m), 3), np.nan, np.float32)
    for v in prange(len(points_m)):
        total = 0.0
        mixed = np.zeros(3)
        low = np.floor(points_m[v] / voxel_m + 1e-3).astype(np.int64)
        for corner in range(8):
            fraction = 1.0
            cell = low.copy()
            for axis in range(3):
                past = points_m[v, axis] / voxel_m - low[axis]
                if corner >> axis & 1:
                    cell[axis] += 1
                    fraction *= max(past, 1e-6)
                else:
                    fraction *= max(1 - past, 1e-6)
            key = packed(cell[0] // BLOCK, cell[1] // BLOCK, cell[2] // BLOCK)
            found = np.searchsorted(sorted_keys, key)
            if found == len(sorted_keys) or sorted_keys[found] != key:
                continue
            b = order[found]
            i, j, k = cell % BLOCK
            if color_weight[b, k, j, i] > 0:
                total += fraction
                mixed += fraction * color[b, k, j, i]
        if total > 0:
            result[v] = mixed / total
    return result


@compiled
def packed(x: Any, y: Any, z: Any) -> Any:
    """Coordinates of blocks, int64, as one number each."""
    return ((x + OFFSET) << (2 * BITS)) | ((y + OFFSET) << BITS) | (z + OFFSET)
