"""The grid of a raster map: where its cells lie."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", float, NDArray[np.float64])


def bounds(parts: Iterable[NDArray[np.floating]]) -> tuple[Any, Any]:
    """The lowest and the highest of points (n, k), part by part: (k,) each; infinite without."""
    low, high = np.inf, -np.inf
    for points in parts:
        if len(points):
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return low, high


def widened(
    window: tuple[slice, slice], before: int, after: int, shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """A window with so many cells more before and after it along both axes, as far as the raster
    reaches; and where it lies therein.
    """
    rows, columns = (
        slice(max(side.start - before, 0), min(side.stop + after, length))
        for side, length in zip(window, shape, strict=False)
    )
    inner_rows, inner_columns = (
        slice(side.start - wide.start, side.stop - wide.start)
        for side, wide in zip(window, (rows, columns), strict=True)
    )
    return (rows, columns), (inner_rows, inner_columns)


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

    def moved(self, offset_m: Sequence[float] | NDArray[np.float64]) -> "Grid":
        """The same cells in coordinates to which an offset (x, y, ...) was added."""
        return replace(self, west_m=self.west_m + offset_m[0], north_m=self.north_m + offset_m[1])

    def window(self, rows: slice, columns: slice) -> "Grid":
        """The cells of a window."""
        return Grid(
            self.west_m + columns.start * self.cell_m,
            self.north_m - rows.start * self.cell_m,
            self.cell_m,
            (rows.stop - rows.start, columns.stop - columns.start),
        )

    def pixels(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert points (N, 2 or more) to column and row (N, 2); (0, 0) is a center."""
        points = np.asarray(points_m, np.float64)
        return np.stack([self.columns(points[:, 0]), self.rows(points[:, 1])], axis=-1)

    def cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """The column and row of the cell at a place."""
        return (
            int(np.floor((x_m - self.west_m) / self.cell_m)),
            int(np.floor((self.north_m - y_m) / self.cell_m)),
        )

    def columns(self, x_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert x to columns."""
        return np.asarray((x_m - self.west_m) / self.cell_m - 0.5, np.float64)

    def rows(self, y_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert y to rows."""
        return np.asarray((self.north_m - y_m) / self.cell_m - 0.5, np.float64)

    def center(self, column: Number, row: Number) -> tuple[Number, Number]:
        """The x and y of the centers of cells."""
        return self.west_m + (column + 0.5) * self.cell_m, self.north_m - (row + 0.5) * self.cell_m

    def axes(self, rows: slice, columns: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The x (w,) and y (h,) of the cells' centers in a window."""
        return self.center(
            np.arange(columns.start, columns.stop, dtype=np.float64),
            np.arange(rows.start, rows.stop, dtype=np.float64),
        )

    def centers(
        self, rows: slice, columns: slice
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The x and y of the cells' centers in a window, (h, w) each."""
        x_m, y_m = self.axes(rows, columns)
        grid_x, grid_y = np.meshgrid(x_m, y_m)
        return grid_x, grid_y
