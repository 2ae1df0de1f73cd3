"""What a frame has for the cells of a mosaic, and how far its colors are from the other frames'."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled

NEAREST_M = 0.05
"""Nearer than the cameras' housing nothing is seen, meters."""
NEIGHBOR = 1e-3
"""Weight of a pixel, in bilinear interpolation, below which it need not be known."""


@compiled
def see(
    x_m: Any,  # (w,) float64, of the cells
    y_m: Any,  # (h,) float64
    z_m: Any,  # (h, w) float64, NaN where unknown
    T: Any,  # (4, 4) float64, camera from map
    center_m: Any,  # (3,) float64, of the camera
    camera: Any,  # (3,) float64: focal_px, cx, cy
    rgb: Any,  # (H, W, 3) uint8
    range_m: Any,  # (H, W) float32
    doubtful: Any,  # (H, W) bool
    limits: Any,  # (3,) float64: hidden_m, hidden_fraction, doubtful_cost
    color: Any,  # (h, w, 3) uint8, written
    cost: Any,  # (h, w) float32, written: infinite where the frame does not see the cell
) -> int:
    """Colors of the cells by one frame, bilinear, and what each costs; how many it sees.

    A cell is hidden where the range measured at its pixel is another: something stands before it, or it moved. Pixels without a
    range may be painted black, and must not bleed into their neighbors.
    """
    height, width = range_m.shape
    seen = 0
    for r in range(len(y_m)):
        for c in range(len(x_m)):
            cost[r, c] = np.inf
            x, y, z = x_m[c], y_m[r], z_m[r, c]
            depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
            if not depth > NEAREST_M:
                continue
            across = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
            down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
            u, v = camera[0] * across / depth + camera[1], camera[0] * down / depth + camera[2]
            if u < 1 or v < 1 or u > width - 2 or v > height - 2:
                continue
            row, column = int(v + 0.5), int(u + 0.5)
            distance = np.sqrt(across * across + down * down + depth * depth)
            if not np.abs(range_m[row, column] - distance) <= limits[0] + limits[1] * distance:
                continue
            if not _blended(rgb, range_m, u, v, color[r, c]):
                continue
            east, north, above = x - center_m[0], y - center_m[1], center_m[2] - z
            cost[r, c] = np.sqrt(east * east + north * north) / max(above, NEAREST_M) + limits[2] * doubtful[row, column]
            seen += 1
    return seen


@compiled
def _blended(rgb: Any, range_m: Any, u: float, v: float, color: Any) -> bool:
    """Write the color between four pixels; False where one of them that counts has no range."""
    column, row = int(u), int(v)
    right, below = np.float32(u - column), np.float32(v - row)
    left, above = np.float32(1) - right, np.float32(1) - below
    a, b, c, d = left * above, right * above, left * below, right * below
    known = (a < NEIGHBOR or np.isfinite(range_m[row, column])) and (b < NEIGHBOR or np.isfinite(range_m[row, column + 1]))
    known = known and (c < NEIGHBOR or np.isfinite(range_m[row + 1, column]))
    if not (known and (d < NEIGHBOR or np.isfinite(range_m[row + 1, column + 1]))):
        return False
    for k in range(3):
        value = a * rgb[row, column, k] + b * rgb[row, column + 1, k]
        value += c * rgb[row + 1, column, k] + d * rgb[row + 1, column + 1, k]
        color[k] = np.uint8(min(value + np.float32(0.5), np.float32(255)))
    return True


@compiled
def disagree(color: Any, cost: Any, cost_a_level: float) -> None:
    """Add to ``cost`` (views, h, w) what the color (views, h, w, 3) of a view is off the median of all views that see the cell."""
    views, height, width = cost.shape
    values = np.empty(views)
    for r in range(height):
        for c in range(width):
            for k in range(3):
                count = 0
                for view in range(views):
                    if cost[view, r, c] < np.inf:
                        value = float(color[view, r, c, k])
                        place = count
                        while place > 0 and values[place - 1] > value:
                            values[place] = values[place - 1]
                            place -= 1
                        values[place] = value
                        count += 1
                if count < 2:
                    break
                median = (values[(count - 1) // 2] + values[count // 2]) / 2
                for view in range(views):
                    cost[view, r, c] += cost_a_level * abs(color[view, r, c, k] - median)
