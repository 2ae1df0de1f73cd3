"""Outlines drawn on a map, of a colony or of a kind of bottom, in meters in the map's own
coordinates.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.grid import Grid

Ring = NDArray[np.float64]
SUBCELL_BITS = 4
"""Corners are drawn to a sixteenth of a cell."""
FARTHEST_CELLS = 1e6
"""Corners farther off, of another continent, are drawn there: in sixteenths they would not fit into
32 bits.
"""


@dataclass(frozen=True, eq=False)
class Outline:
    """One outline. name: "" if it has none. label: what it shows. rings: (N, 2) x and y in meters;
    holes are rings too.
    """

    name: str
    label: str
    rings: tuple[Ring, ...]

    def mask(self, grid: Grid) -> NDArray[np.bool_]:
        """Compute which cells have their centers inside: (H, W) bool; a ring within a ring is a
        hole.
        """
        mask = np.zeros(grid.shape, np.uint8)
        near = [np.clip(grid.pixels(ring), -FARTHEST_CELLS, FARTHEST_CELLS) for ring in self.rings]
        corners = [np.rint(pixels * 2**SUBCELL_BITS).astype(np.int32) for pixels in near]
        cv2.fillPoly(mask, corners, 1, shift=SUBCELL_BITS)
        edge = np.zeros_like(mask)
        cv2.polylines(edge, corners, True, 1, shift=SUBCELL_BITS)
        rows, columns = np.nonzero(edge)
        mask[rows, columns] = self._inside(np.stack([columns, rows], axis=-1), grid)
        return mask.astype(bool)

    def _inside(self, cells: NDArray[np.int64], grid: Grid) -> NDArray[np.bool_]:
        """Which of cells (N, 2) have their centers inside: crossings of a line to the east,
        counted.
        """
        count = np.zeros(len(cells), np.int64)
        for ring in self.rings:
            corners = grid.pixels(ring)
            for (x1, y1), (x2, y2) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                crosses = (y1 > cells[:, 1]) != (y2 > cells[:, 1])
                slope = (x2 - x1) / (y2 - y1) if y1 != y2 else 0.0
                count += crosses & (cells[:, 0] < x1 + (cells[:, 1] - y1) * slope)
        return np.asarray(count % 2 == 1)
