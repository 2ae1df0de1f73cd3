"""The slant of measured surfaces: at grazing angles the truncation along the ray is longer."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled

SLANT_PX = 8
"""Pixels over which the slant of a surface is measured: an error of a fifth of a pixel of disparity
slants it by 30 degrees at a disparity of 10 px and a focal length of 350 px.
"""
LEAST_SINE = 0.35
"""Of the angle between ray and surface, from which on the truncation of 3 voxels reaches a whole
voxel below the surface. At 10 degrees it is half a voxel, and ground then comes out in stripes.
"""
MOST_SLANT_FACTOR = 4.0
"""Rays at 5 degrees: what is seen from farther aside is too uncertain."""


@compiled
def slant_factors(
    # (H + 2 SLANT_PX, W + 2 SLANT_PX) float32, 1 / depth inside a frame of zeros: 0 where nothing
    # was measured
    inverse: Any,
    camera: Any,  # (3,) float64: focal_px, cx, cy
    # (H, W) float32, written: by how much the truncation grows along a pixel's ray, 1 for none
    slant_factor: Any,
    left: int,
    right: int,
    first: int,
    last: int,
) -> None:
    """Write by how much the truncation grows along each pixel's ray, in the columns from left to
    right - 1 and the rows from first to last - 1.

    The inverse depth of a plane is linear in pixels, so that its slopes and its value give the
    normal. Without branches, for vector instructions.
    """
    focal_px, cx, cy = np.float32(camera[0]), np.float32(camera[1]), np.float32(camera[2])
    one, least_sine, most = np.float32(1), np.float32(LEAST_SINE), np.float32(MOST_SLANT_FACTOR)
    scale = focal_px / np.float32(SLANT_PX)
    for row in range(first, last):
        y = (np.float32(row) - cy) / focal_px
        above, here = inverse[row], inverse[row + SLANT_PX]
        below = inverse[row + 2 * SLANT_PX]
        for column in range(left, right):
            x = (np.float32(column) - cx) / focal_px
            middle = here[column + SLANT_PX]
            a = scale * _slope(here[column], middle, here[column + 2 * SLANT_PX])
            b = scale * _slope(above[column + SLANT_PX], middle, below[column + SLANT_PX])
            c = middle - a * x - b * y
            sine = middle / np.sqrt((a * a + b * b + c * c) * (one + x * x + y * y))
            slant_factor[row, column] = min(max(least_sine / sine, one), most)


@compiled
def _slope(before: Any, middle: Any, behind: Any) -> Any:
    """Change of the inverse depth over SLANT_PX along one axis: the smaller of both sides, so that
    it holds on both.

    0 where they differ in sign (a branch, a ridge) or one is not measured (an edge of what was
    seen).
    """
    rise, fall = behind - middle, middle - before
    slope = rise if abs(rise) < abs(fall) else fall
    return slope if (before > 0) & (behind > 0) & (rise * fall > 0) else np.float32(0)
