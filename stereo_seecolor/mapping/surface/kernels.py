"""Weighted TSDF integration of one frame into a range of voxel blocks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.surface.color_weight import color_weight
from stereo_seecolor.mapping.surface.slant import SLANT_PX

BLOCK = 8
"""Voxels along the edge of a block."""

CELL = 16
"""Pixels along the edge of the cells whose deepest measurement is known."""
NEAREST_DEPTH_M = 0.05
"""Nearer than the cameras' housing nothing is measured, meters."""
BITS = 21
"""Of a block's coordinate in a packed number: three of them fit into 63."""
OFFSET = 1 << (BITS - 1)


@compiled
def weigh(
    range_m: Any,  # (H, W) float32
    range_std_m: Any,  # (H, W) float32
    confidence: Any,  # (H, W) uint8, 255 for 1
    ray_length: Any,  # (H, W) float32: range over depth
    voxel_m: float,
    depth_m: Any,  # (H, W) float32, written
    weight: Any,  # (H, W) float32, written: 0 where nothing was measured
    # (H + 2 SLANT_PX, W + 2 SLANT_PX) float32: written inside a frame of zeros: 1 / depth_m, 0
    # where there is none
    inverse: Any,
    # (H / CELL, W / CELL) float32, rounded up, written: of each cell of CELL x CELL pixels, 0 where
    # there is none
    deepest_m: Any,
    left: int,
    right: int,
    first: int,
    last: int,
) -> None:
    """Compute depths and weights of a frame's pixels, in the columns of cells from left to right -
    1 and the rows from first to last - 1.

    Weight = confidence (voxel / standard error)^2. The error of stereo grows with the square of the
    range; without regard to that, one near fish would outweigh all that see through it.
    """
    for row in range(first * CELL, min(last * CELL, range_m.shape[0])):
        if row % CELL == 0:
            deepest_m[row // CELL, left:right] = 0
        for column in range(left * CELL, min(right * CELL, range_m.shape[1])):
            measured, std = range_m[row, column], range_std_m[row, column]
            trust = np.float32(confidence[row, column]) / np.float32(255)
            weight[row, column] = 0
            inverse[row + SLANT_PX, column + SLANT_PX] = 0
            if not (measured > 0 and trust > 0 and measured < np.inf):
                continue
            depth = np.float32(measured / ray_length[row, column])
            depth_m[row, column] = depth
            inverse[row + SLANT_PX, column + SLANT_PX] = np.float32(1) / depth
            ratio = voxel_m / std
            weight[row, column] = trust * (ratio * ratio) if std > 0 else trust
            cell = column // CELL
            deepest_m[row // CELL, cell] = max(deepest_m[row // CELL, cell], depth)


def windows_of(
    keys: NDArray[np.int32],
    shape: tuple[int, ...],
    camera: NDArray[np.float64],
    T: NDArray[np.float64],
    voxel_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Find the cells that the sphere around each block covers in the image: (B, 4) top, bottom,
    left, right, where bottom and right are excluded; and the sphere's least depth (B,). None behind
    the camera.

    keys: (B, 3) block coordinates. shape: rows and columns of cells of an image. camera: (3,)
    focal_px, cx, cy. T: (4, 4) camera from world.
    """
    radius = 0.87 * BLOCK * voxel_m
    middle = (keys * BLOCK + BLOCK / 2) * voxel_m
    x, y, z = (middle @ T[:3, :3].T + T[:3, 3]).T
    near = z < 2 * radius
    ahead = np.where(near, 2 * radius, z)
    margin = 2 * radius / (ahead - radius)
    windows = np.empty((len(keys), 4), np.int64)
    for place, along, center_px, count in (
        (0, y, camera[2], shape[0]),
        (2, x, camera[1], shape[1]),
    ):
        low_px = camera[0] * (along / ahead - margin) + center_px
        high_px = camera[0] * (along / ahead + margin) + center_px
        # one pixel more at each end
        low, high = np.floor((low_px - 1) / CELL), np.floor((high_px + 1) / CELL) + 1
        windows[:, place] = np.where(near, 0, np.clip(low, 0, count))
        windows[:, place + 1] = np.where(near, count, np.clip(high, 0, count))
    windows[z < -radius] = 0
    return windows, np.where(near, 0.0, z - radius)


def cells_of(windows: NDArray[np.int64]) -> tuple[int, int, int, int]:
    """Find the window of cells that the windows of blocks cover together."""
    covered = windows[(windows[:, 0] < windows[:, 1]) & (windows[:, 2] < windows[:, 3])]
    if not len(covered):
        return 0, 0, 0, 0
    low, high = covered.min(axis=0), covered.max(axis=0)
    return int(low[0]), int(high[1]), int(low[2]), int(high[3])


@compiled
def in_sight(
    windows: Any,  # (B, 4) int64, of ``windows_of``
    nearest_m: Any,  # (B,) float64, of ``windows_of``
    deepest_m: Any,  # of ``weigh``, known where ``cells_of`` says
    truncation_m: float,
    seen: Any,  # (B,) bool, written
) -> None:
    """Write of which blocks a part may lie before a measurement, or within the truncation behind.

    Of each block its enclosing sphere is compared with the deepest measurement in the window of the
    image that it covers.
    """
    for b in range(len(windows)):
        deepest = np.float32(0)
        for row in range(windows[b, 0], windows[b, 1]):
            for column in range(windows[b, 2], windows[b, 3]):
                deepest = max(deepest, deepest_m[row, column])
        seen[b] = deepest > max(nearest_m[b] - truncation_m, 0.0)


@compiled
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
    slant_factor: Any,  # (H, W) float32, of ``slant_factors``: of the truncation
    camera: Any,  # (3,) float64: focal_px, cx, cy
    T: Any,  # (4, 4) float64, camera from world
    voxel_m: float,
    truncation_m: float,
    chosen: Any,  # (n,) int64, of ``in_sight``
    first: int,
    last: int,
) -> None:
    """Update the voxels of the blocks chosen[first:last] that project onto a measured pixel and lie
    no deeper behind it than the truncation.

    Curless and Levoy's (1996) running weighted mean, of distance and of color. Voxels in front of
    the surface are updated as well: that carves away what other frames saw only once, such as fish.
    """
    for b in chosen[first:last]:
        corner = (
            keys[b, 0] * BLOCK * voxel_m,
            keys[b, 1] * BLOCK * voxel_m,
            keys[b, 2] * BLOCK * voxel_m,
        )
        for k, j in np.ndindex((BLOCK, BLOCK)):
            start = in_camera(T, corner[0], corner[1] + j * voxel_m, corner[2] + k * voxel_m)
            for i in range(BLOCK):
                along = i * voxel_m
                z = start[2] + T[2, 0] * along
                if z <= NEAREST_DEPTH_M:
                    continue
                across, down = (start[0] + T[0, 0] * along) / z, (start[1] + T[1, 0] * along) / z
                u, v = camera[0] * across + camera[1] + 0.5, camera[0] * down + camera[2] + 0.5
                w = _at(pixel_weight, v, u)
                if w == 0:
                    continue
                row, column = np.uint64(v), np.uint64(u)
                # Compared by depth, which is the same all over a pixel that looks at level ground;
                # range is not.
                measured = depth_m[row, column]
                ray_length = np.sqrt(1 + across * across + down * down)
                signed = (measured - z) * ray_length
                reach_m = truncation_m * slant_factor[row, column]
                if signed < -reach_m:
                    continue
                # free space: as certain as a measurement at the voxel's own distance
                if signed > reach_m:
                    w *= (measured / z) ** 4
                total = weight[b, k, j, i] + w
                value = min(1.0, signed / reach_m)
                tsdf[b, k, j, i] += (value - tsdf[b, k, j, i]) * w / total
                weight[b, k, j, i] = total
                if signed <= reach_m:
                    vertical = abs(T[0, 2] * across + T[1, 2] * down + T[2, 2]) / ray_length
                    pixel_m = z * ray_length / (camera[0] * max(vertical, 0.05))
                    w = color_weight(pixel_m / voxel_m, doubtful[row, column])
                    color_weights[b, k, j, i] += w
                    for c in range(3):
                        color[b, k, j, i, c] += (
                            (rgb[row, column, c] - color[b, k, j, i, c])
                            * w
                            / color_weights[b, k, j, i]
                        )


@compiled
def _at(image: Any, row: float, column: float) -> Any:
    """The value of the pixel there; 0 beside the image."""
    inside = row >= 0 and column >= 0 and row < image.shape[0] and column < image.shape[1]
    return image[np.uint64(row), np.uint64(column)] if inside else np.float32(0)


@compiled
def in_camera(T: Any, x: float, y: float, z: float) -> Any:
    """A point of the world in the camera. T: (4, 4) float64, camera from world."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


def packed(x: Any, y: Any, z: Any) -> Any:
    """Pack the int64 coordinates of a block into one number, which sorts as (x, y, z) does."""
    return ((x + OFFSET) << (2 * BITS)) | ((y + OFFSET) << BITS) | (z + OFFSET)
