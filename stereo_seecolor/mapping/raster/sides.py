"""Which steps of a terrain have their sides in the mesh: a terrain, which is seen from above, does
not tell a boulder from a table.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.records import Array

STEP_CELLS = 2.0
"""Cells by which one cell is higher than another where they show two things: steeper than 63
degrees.
"""
STEP_STDS = 6.0
"""Standard errors of a height by which it must be: no step is smaller than the noise."""
SIDES_SEEN = 0.5
"""Part of its sides in the mesh from which a thing is taken to reach down to the ground."""
PART = 100_000
"""Triangles that are measured at once: all of a tile of terrain would take 300 MiB."""
FALLS = ((0, 1), (0, -1), (1, 1), (1, -1))
"""Axis and shift of the four cells beside each."""


def step_m(cell_m: float, std_m: float) -> float:
    """The difference in height beyond which two points lie on two things. std_m: of a height."""
    return max(STEP_CELLS * cell_m, STEP_STDS * std_m)


def area_over(
    points_m: NDArray[np.floating], triangles: NDArray[np.integer[Any]], grid: Grid
) -> Array:
    """(H, W) square meters of mesh over each cell. points_m: (V, 3). triangles: (T, 3)."""
    height, width = grid.shape
    over_m2 = np.zeros(height * width)
    for first in range(0, len(triangles), PART):
        corners = np.asarray(points_m[triangles[first : first + PART]], np.float64)
        a, b, c = np.moveaxis(corners, 1, 0)
        area_m2 = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        column, row = np.rint(grid.pixels((a + b + c) / 3)).astype(np.int64).T
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        np.add.at(over_m2, row[inside] * width + column[inside], area_m2[inside])
    return over_m2.reshape(height, width)


def sides_seen(heights: Array, mesh_m2: Array, cell_m: float, gap_m: float) -> NDArray[np.bool_]:
    """Whether the mesh holds the sides of what stands at each cell, (H, W): over the cells around
    it lies as much more than level ground as half of the steps there need.

    heights: (H, W), NaN where unknown. mesh_m2: ``area_over``. gap_m: a larger fall to a cell
    beside is a step. The outermost cells are judged by fewer around.
    """
    around = np.pad(heights, 1, constant_values=np.nan)
    steps_m = np.zeros(heights.shape)
    for axis, shift in FALLS:
        fall = np.nan_to_num(heights - np.roll(around, shift, axis)[1:-1, 1:-1])
        steps_m += np.where(fall > gap_m, fall, 0)
    more_m2 = mesh_m2 - np.isfinite(heights) * cell_m**2
    more_m2, needed_m2 = (
        cv2.boxFilter(each, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for each in (more_m2, steps_m * cell_m)
    )
    return np.asarray((steps_m > 0) & (more_m2 > SIDES_SEEN * needed_m2))
