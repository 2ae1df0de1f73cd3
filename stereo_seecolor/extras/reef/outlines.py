"""Outlines drawn on a map, of a colony or of a kind of bottom, in meters in the map's own
coordinates.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.polygons import cells_inside
from stereo_seecolor.mapping.raster.grid import Grid

Ring = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outline:
    """One outline. name: "" if it has none. label: what it shows. rings: (N, 2) x and y in meters;
    holes are rings too.
    """

    name: str
    label: str
    rings: tuple[Ring, ...]

    def mask(self, grid: Grid) -> NDArray[np.bool_]:
        """The cells whose centers lie inside: (H, W) bool; a ring within a ring is a hole."""
        corners = [grid.pixels(ring) for ring in self.rings]
        return cells_inside(corners, 0, 0, grid.shape)
