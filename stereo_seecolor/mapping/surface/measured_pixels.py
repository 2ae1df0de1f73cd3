"""Depths and weights of a frame's pixels, computed where blocks of the tile project into it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.mapping.surface.kernels import CELL, weigh
from stereo_seecolor.mapping.surface.slant import SLANT_PX, slant_factors
from stereo_seecolor.records import Map, SurveyFrame

Cells = tuple[int, int, int, int]
"""A window of cells of CELL x CELL pixels: top, bottom, left, right; the rows top to bottom - 1,
the columns left to right - 1.
"""


@dataclass(frozen=True, eq=False)
class MeasuredPixels:
    """Buffers that one frame after the other is weighed in: new memory takes as long as the work.

    camera: (3,) focal_px, cx, cy. depth_m, weight, inverse, deepest_m, slant_factor: as the kernels
    write them, valid in the cells that were weighed last.
    """

    geometry: RectifiedPair
    camera: NDArray[np.float64]
    depth_m: Map
    weight: Map
    inverse: Map
    deepest_m: Map
    slant_factor: Map

    @classmethod
    def room(cls, geometry: RectifiedPair) -> "MeasuredPixels":
        """Allocate the buffers for images of this geometry; undefined until ``weigh`` is called."""
        width, height = geometry.image_size
        camera = np.array([geometry.focal_px, geometry.cx_left_px, geometry.cy_px])
        depth_m, weight, slant_factor = (np.empty((height, width), np.float32) for _ in range(3))
        inverse = np.zeros((height + 2 * SLANT_PX, width + 2 * SLANT_PX), np.float32)
        deepest_m = np.empty((-(-height // CELL), -(-width // CELL)), np.float32)
        return cls(geometry, camera, depth_m, weight, inverse, deepest_m, slant_factor)

    def weigh(self, frame: SurveyFrame, cells: Cells, voxel_m: float) -> None:
        """Compute depths, weights and slant factors of a frame's pixels in these cells.

        Depths are also computed in the cells next to them, since the slant of a surface is measured
        over its neighborhood.
        """
        top, bottom, left, right = cells
        if top >= bottom or left >= right:
            return
        rows, columns = self.deepest_m.shape
        above, below = max(top - 1, 0), min(bottom + 1, rows)
        before, behind = max(left - 1, 0), min(right + 1, columns)

        def weigh_rows(first: int, last: int) -> None:
            weigh(
                frame.range_m, frame.range_std_m, frame.confidence, self.geometry.ray_length,
                voxel_m, self.depth_m, self.weight, self.inverse, self.deepest_m, before, behind,
                above + first, above + last,
            )  # fmt: skip

        in_parts(weigh_rows, below - above)
        height, width = self.depth_m.shape
        first_row, first_column = top * CELL, left * CELL
        last_row, last_column = min(bottom * CELL, height), min(right * CELL, width)

        def slant_rows(first: int, last: int) -> None:
            slant_factors(
                self.inverse, self.camera, self.slant_factor, first_column, last_column,
                first_row + first, first_row + last,
            )  # fmt: skip

        in_parts(slant_rows, last_row - first_row)
