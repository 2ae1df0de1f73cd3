"""Depths and weights of a frame's pixels, as far as the blocks of a tile fall on them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.mapping.surface.kernels import CELL, weigh
from stereo_seecolor.mapping.surface.slant import SLANT_PX, stretches
from stereo_seecolor.records import Map, SurveyFrame

Cells = tuple[int, int, int, int]
"""Rows of cells from the first to before the second, columns from the third to before the fourth."""


@dataclass(frozen=True, eq=False)
class MeasuredPixels:
    """Room for one frame after the other: fresh memory for each would cost as much time as the work in it.

    camera: (3,) focal_px, cx, cy. depth_m, weight, inverse, deepest_m, stretch: as the kernels write them, known in the cells that
    were examined last.
    """

    geometry: RectifiedPair
    camera: NDArray[np.float64]
    depth_m: Map
    weight: Map
    inverse: Map
    deepest_m: Map
    stretch: Map

    @classmethod
    def room(cls, geometry: RectifiedPair) -> "MeasuredPixels":
        """Nothing examined yet."""
        width, height = geometry.image_size
        camera = np.array([geometry.focal_px, geometry.cx_left_px, geometry.cy_px])
        depth_m, weight, stretch = (np.empty((height, width), np.float32) for _ in range(3))
        inverse = np.zeros((height + 2 * SLANT_PX, width + 2 * SLANT_PX), np.float32)
        deepest_m = np.empty((-(-height // CELL), -(-width // CELL)), np.float32)
        return cls(geometry, camera, depth_m, weight, inverse, deepest_m, stretch)

    def look(self, frame: SurveyFrame, cells: Cells, voxel_m: float) -> None:
        """At these cells of a frame, and at the next ones around them, which slants are measured by."""
        top, bottom, left, right = cells
        if top >= bottom or left >= right:
            return
        rows, columns = self.deepest_m.shape
        first, last, start, end = max(top - 1, 0), min(bottom + 1, rows), max(left - 1, 0), min(right + 1, columns)
        pixels = frame.range_m, frame.range_std_m, frame.confidence, self.geometry.ray_length, voxel_m
        found = self.depth_m, self.weight, self.inverse, self.deepest_m
        in_parts(lambda a, b: weigh(*pixels, *found, start, end, first + a, first + b), last - first)
        height, width = self.depth_m.shape
        first, last, start, end = top * CELL, min(bottom * CELL, height), left * CELL, min(right * CELL, width)
        in_parts(lambda a, b: stretches(self.inverse, self.camera, self.stretch, start, end, first + a, first + b), last - first)
