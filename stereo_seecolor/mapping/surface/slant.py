"""How far behind what a pixel measured its surface is looked for: farther where it is seen at a grazing angle."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled

SLANT_PX = 8
"""Pixels over which the slant of a surface is measured: an error of a fifth of a pixel of disparity slants it by 30 degrees at a
disparity of 10 px and a focal length of 350 px."""
LEAST_SINE = 0.35
"""Of the angle between ray and surface, from which on the truncation of 3 voxels reaches a whole voxel below the surface. At 10
degrees it is half a voxel, and ground then comes out in stripes."""
MOST_STRETCH = 4.0
"""Rays at 5 degrees: what is seen from farther aside is too uncertain."""


@compiled
def stretches(
    depth_m: Any,  # (H, W) float32
    weight: Any,  # (H, W) float32: 0 where nothing was measured
    camera: Any,  # (3,) float64: focal_px, cx, cy
    stretch: Any,  # (H, W) float32, written: by how much the truncation grows along a pixel's ray, 1 for none
    first: int,
    last: int,
) -> None:
    """For the rows from first to before last.

    The inverse depth of a plane is linear in pixels, so that its slopes and its value give the normal.
    """
    for row in range(first, last):
        for column in range(depth_m.shape[1]):
            stretch[row, column] = 1.0
            if weight[row, column] == 0:
                continue
            inverse = 1 / depth_m[row, column]
            x, y = (column - camera[1]) / camera[0], (row - camera[2]) / camera[0]
            a = _slope(depth_m, weight, row, column, 0, 1, inverse) * camera[0]
            b = _slope(depth_m, weight, row, column, 1, 0, inverse) * camera[0]
            c = inverse - a * x - b * y
            sine = inverse / np.sqrt((a * a + b * b + c * c) * (1 + x * x + y * y))
            if sine < LEAST_SINE:
                stretch[row, column] = min(LEAST_SINE / sine, MOST_STRETCH)


@compiled
def _slope(depth_m: Any, weight: Any, row: int, column: int, down: int, across: int, inverse: float) -> float:
    """Change of the inverse depth a pixel along one axis: the smaller of both sides, so that it holds on both.

    0 where they differ in sign (a branch, a ridge) or one is not measured (an edge of what was seen).
    """
    least = np.inf
    for side in (-SLANT_PX, SLANT_PX):
        r, c = row + side * down, column + side * across
        if r < 0 or c < 0 or r >= depth_m.shape[0] or c >= depth_m.shape[1] or weight[r, c] == 0:
            return 0.0
        slope = (1 / depth_m[r, c] - inverse) / side
        if least < np.inf and slope * least <= 0:
            return 0.0
        if abs(slope) < abs(least):
            least = slope
    return least
