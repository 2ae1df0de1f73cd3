"""Compiled loops of the orthomosaic: a frame's colors of its cells, and how far they are from the
other frames' colors.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.surface.color_weight import color_weight
from stereo_seecolor.mapping.surface.kernels import NEAREST_DEPTH_M

NEIGHBOR = 1e-3
"""Weight of a pixel, in bilinear interpolation, below which it need not be known."""


@compiled
def see(
    x_m: Any,  # (w,) float64, of the cells
    y_m: Any,  # (h,) float64
    z_m: Any,  # (h, w) float64, NaN where unknown
    other_m: Any,  # (h, w) float64: height that a cell at a step may have instead, NaN elsewhere
    T: Any,  # (4, 4) float64, camera from map
    center_m: Any,  # (3,) float64, of the camera
    camera: Any,  # (3,) float64: focal_px, cx, cy
    rgb: Any,  # (H, W, 3) uint8
    range_m: Any,  # (H, W) float32
    doubtful: Any,  # (H, W) bool
    limits: Any,  # (4,) float64: hidden_m, hidden_fraction, doubtful_cost, edge of a cell in meters
    color: Any,  # (h, w, 3) uint8, written
    cost: Any,  # (h, w) float32, written: infinite where the frame does not see the cell
    weight: Any,  # (h, w) float32, written where it does: of its color in the mean of all views
) -> int:
    """Write the colors of the cells as one frame sees them, bilinear, with the cost and the weight
    of each; return how many it sees.

    A cell is hidden where the range measured at its pixel is another: something stands before it,
    or it moved. At a step of the terrain, whose cells are larger, it may lie at the other height.
    Pixels without a range may be painted black, and must not bleed into their neighbors.
    """
    height, width = range_m.shape
    focal_px, cx, cy = camera[0], camera[1], camera[2]
    hidden_m, hidden_fraction, doubtful_cost, cell_m = limits[0], limits[1], limits[2], limits[3]
    right_x, right_y, right_z, right_0 = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    down_x, down_y, down_z, down_0 = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    depth_x, depth_y, depth_z, depth_0 = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    seen = 0
    for r in range(len(y_m)):
        y = y_m[r]
        for c in range(len(x_m)):
            cost[r, c] = np.inf
            x = x_m[c]
            for z in (z_m[r, c], other_m[r, c]):
                depth = depth_x * x + depth_y * y + depth_z * z + depth_0
                if not depth > NEAREST_DEPTH_M:
                    continue
                across = right_x * x + right_y * y + right_z * z + right_0
                down = down_x * x + down_y * y + down_z * z + down_0
                u, v = focal_px * across / depth + cx, focal_px * down / depth + cy
                if u < 1 or v < 1 or u > width - 2 or v > height - 2:
                    continue
                row, column = np.uint64(v + 0.5), np.uint64(u + 0.5)
                distance = np.sqrt(across * across + down * down + depth * depth)
                if (
                    not np.abs(range_m[row, column] - distance)
                    <= hidden_m + hidden_fraction * distance
                ):
                    continue
                if not _blended(rgb, range_m, u, v, color, r, c):
                    continue
                east, north, above = x - center_m[0], y - center_m[1], center_m[2] - z
                slant = np.sqrt(east * east + north * north) / max(above, NEAREST_DEPTH_M)
                cost[r, c] = slant + doubtful_cost * doubtful[row, column]
                weight[r, c] = color_weight(
                    distance * np.sqrt(1 + slant * slant) / (focal_px * cell_m),
                    doubtful[row, column],
                )
                seen += 1
                break
    return seen


@compiled(inline=True)
def _blended(rgb: Any, range_m: Any, u: float, v: float, color: Any, y: int, x: int) -> bool:
    """Write the color between four pixels to color[y, x]; False where one has no range."""
    column, row = np.uint64(u), np.uint64(v)
    right, below = np.float32(u - np.floor(u)), np.float32(v - np.floor(v))
    next_column, next_row = column + np.uint64(1), row + np.uint64(1)
    left, above = np.float32(1) - right, np.float32(1) - below
    a, b, c, d = left * above, right * above, left * below, right * below
    known = ((a < NEIGHBOR) | np.isfinite(range_m[row, column])) & (
        (b < NEIGHBOR) | np.isfinite(range_m[row, next_column])
    )
    # not "or": branches that hang on fractions take twice as long
    known &= (c < NEIGHBOR) | np.isfinite(range_m[next_row, column])
    known &= (d < NEIGHBOR) | np.isfinite(range_m[next_row, next_column])
    if not known:
        return False
    for k in range(3):
        value = a * rgb[row, column, k] + b * rgb[row, next_column, k]
        value += c * rgb[next_row, column, k] + d * rgb[next_row, next_column, k]
        color[y, x, k] = np.uint8(min(value + np.float32(0.5), np.float32(255)))
    return True


@compiled
def agree(
    boxes: Any,
    color: Any,
    cost: Any,
    weight: Any,
    cost_a_level: float,
    outlier_levels: float,
    mean: Any,
    first: int,
    last: int,
) -> None:
    """Write the mean color (h, w, 3) float32 of all views that see a cell, and add to each view's
    cost its distance from their median.

    first, last: the rows from the one to before the other.
    boxes: (views, 5) int64: rows from the first number to before the second and columns from the
    third to before the fourth, whose cells lie row by row, from the fifth on, in: color (n, 3)
    uint8; cost (n,), infinite where a view does not see the cell.
    weight: as cost, of the mean; a color that is off the median by ``outlier_levels`` weighs half
    (Cauchy).
    """
    views, width = len(boxes), mean.shape[1]
    values, seeing, off = np.empty(views, np.int32), np.empty(views, np.int64), np.empty(views)
    for r in range(first, last):
        for c in range(width):
            count = 0
            for view in range(views):
                top, bottom, left, right, start = boxes[view]
                if top <= r < bottom and left <= c < right:
                    at = start + (r - top) * (right - left) + c - left
                    if cost[at] < np.inf:
                        seeing[count] = at
                        off[count] = 0
                        count += 1
            for k in range(3):
                median = _median(color, k, seeing, count, values)
                for n in range(count):
                    off[n] += abs(color[seeing[n], k] - median)
            total = 0.0
            for n in range(count):
                cost[seeing[n]] += cost_a_level * off[n]
                w = weight[seeing[n]] / (1 + (off[n] / (3 * outlier_levels)) ** 2)
                total += w
                for k in range(3):
                    mean[r, c, k] += (color[seeing[n], k] - mean[r, c, k]) * (w / total)


@compiled(inline=True)
def _median(color: Any, k: int, seeing: Any, count: int, values: Any) -> float:
    """Of channel k over the first ``count`` rows of ``seeing``; 0 of none. values: room for as
    many, int32.
    """
    for n in range(count):
        value = np.int32(color[seeing[n], k])
        for place in range(n):  # sorts it in without branches, which would hang on the colors
            values[place], value = min(values[place], value), max(values[place], value)
        values[n] = value
    return (values[(count - 1) // 2] + values[count // 2]) / 2 if count else 0.0
