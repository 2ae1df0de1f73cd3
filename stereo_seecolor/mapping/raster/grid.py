"""The grid of a raster map: where its cells lie."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


def bounds(parts: Iterable[NDArray[np.floating]]) -> tuple[Any, Any]:
    """The lowest and the highest of points (n, k), part by part: (k,) each; infinite without."""
    low, high = np.inf, -np.inf
    for points in parts:
        if len(points):
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return low, high


@dataclass(frozen=True)
class Grid:
    """North-up cells. west_m, north_m: outer edges of the first cell; its center lies on whole
    multiples of cell_m.

    shape: (rows, columns).
    """

    west_m: float
    north_m: float
    cell_m: float
    shape: tuple[int, int]

    @classmethod
    def around(
        cls, low_m: NDArray[np.floating], high_m: NDArray[np.floating], cell_m: float
    ) -> "Grid":
        """Cover a box with cells that are centered on multiples of cell_m, so that repeated surveys
        share their cells.

        Voxels lie on multiples of their size too: over each of their columns the surface is
        measured, between them interpolated.
        """
        west, south = np.floor(np.asarray(low_m[:2], np.float64) / cell_m + 0.5) - 0.5
        east, north = np.ceil(np.asarray(high_m[:2], np.float64) / cell_m - 0.5) + 0.5
        return cls(
            float(west * cell_m),
            float(north * cell_m),
            cell_m,
            (round(north - south), round(east - west)),
        )

    def pixels(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert points (N, 2 or more) to column and row (N, 2); the center of the first cell is
        (0, 0).
        """
        points = np.asarray(points_m, np.float64)
        return np.stack([self.columns(points[:, 0]), self.rows(points[:, 1])], axis=-1)

    def columns(self, x_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert x to columns."""
        return np.asarray((x_m - self.west_m) / self.cell_m - 0.5, np.float64)

    def rows(self, y_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert y to rows."""
        return np.asarray((self.north_m - y_m) / self.cell_m - 0.5, np.float64)

    def axes(self, rows: slice, columns: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The x (w,) and y (h,) of the cells' centers in a window."""
        x_m = self.west_m + (np.arange(columns.start, columns.stop) + 0.5) * self.cell_m
        y_m = self.north_m - (np.arange(rows.start, rows.stop) + 0.5) * self.cell_m
        return x_m, y_m

    def centers(
        self, rows: slice, columns: slice
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The x and y of the cells' centers in a window, (h, w) each."""
        x_m, y_m = self.axes(rows, columns)
        grid_x, grid_y = np.meshgrid(x_m, y_m)
        return grid_x, grid_y
