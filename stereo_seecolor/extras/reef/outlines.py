"""Outlines drawn on a map, of a colony or kind of bottom, meters in the map's coordinates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef.polygons import cells_inside
from stereo_seecolor.mapping.raster.grid import Grid, bounds
from stereo_seecolor.run_folder.layout import MOSAIC

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


def refuse_elsewhere(
    outlines: Sequence[Outline], grid: Grid, offset_m: NDArray[np.float64]
) -> None:
    """Raise InputError where no outline comes near the map's cells. offset_m: from the map's own
    coordinates to those of the files.
    """
    if not outlines:
        return
    drawn = bounds(ring for outline in outlines for ring in outline.rings)
    rows, columns = grid.shape
    south_m, east_m = grid.north_m - rows * grid.cell_m, grid.west_m + columns * grid.cell_m
    cells = np.array([grid.west_m, south_m]), np.array([east_m, grid.north_m])
    if (drawn[0] <= cells[1]).all() and (drawn[1] >= cells[0]).all():
        return
    (x, y), (left, bottom) = (
        (f"{low:.6g} to {high:.6g}" for low, high in np.transpose(box + offset_m[:2]))
        for box in (np.array(drawn), np.array(cells))
    )
    raise InputError(
        f"no outline lies on the map: they have x {x}, y {y}, the map has x {left}, y {bottom} m: "
        f"draw them on {MOSAIC} in its own coordinates, or name their system as crs"
    )
