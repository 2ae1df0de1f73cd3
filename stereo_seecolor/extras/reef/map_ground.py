"""Points, lengths and areas on the terrain of a map; web/src/terrain.ts computes the same."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.lengths_and_areas import (
    Measured,
    length_along,
    planar_area,
    straight_length,
    unseen_std,
)
from stereo_seecolor.extras.reef.picking import PickedPoint
from stereo_seecolor.extras.reef.polygons import cells_inside, polygon_area
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_errors import RELIEF_CELLS, height_stds, plane_sums
from stereo_seecolor.mapping.raster.sides import step_m
from stereo_seecolor.records import Array, Map


@dataclass(frozen=True)
class TerrainLimits:
    """Limits and thresholds of measurements on a map."""

    least_cells: int = 2  # of 3x3: an object's edge shows at least that
    step_cells: float = 2.0  # along a line: windows that overlap little
    # a step along the ground is longer than its noise, which would lengthen it
    step_stds: float = 6.0
    # what errors of heights, over a cell, add to those of the steepness of an outline: as a slope
    # does, which counts by its sine, and squared; as benchmarks/standard_errors.py finds them
    of_slopes: float = 0.15
    of_squares: float = 0.05
    # the part of what errors of ranges in one frame, which roughen the ground, would add to it
    of_noise: float = 0.25
    # of what a line along the ground is longer than straight lines, so much is smoothed away
    smoothed: float = 0.1
    # level area of an outline over its own: beyond 60 degrees a view from above shows too little of
    # it
    steepest: float = 0.5


TERRAIN = TerrainLimits()


@dataclass(frozen=True, eq=False)
class Spot(PickedPoint):
    """A point of the map, x east, y north, z up. slope: rise to the east and to the north."""

    slope: tuple[float, float]

    def off_m(self, other: Self) -> float:
        """How far another point lies off the plane of the ground here, in height."""
        rise_m = np.array(self.slope) @ (other.point_m - self.point_m)[:2]
        return float(abs(other.point_m[2] - self.point_m[2] - rise_m))


@dataclass(frozen=True, eq=False)
class Ground:
    """A terrain model. heights_m: (H, W), NaN where unknown. std_m: of a height. sides: (H, W)
    whether the sides of what stands at a cell were seen (``sides_seen``); None where that is not
    known. base_m: the height of their zero in the map's world, of a map deep in the sea.
    correlation_m: distance over which errors of heights are alike.
    """

    heights_m: Map
    grid: Grid
    std_m: float
    sides: NDArray[np.bool_] | None = None
    base_m: float = 0.0
    correlation_m: float = 0.0

    @property
    def gap_m(self) -> float:
        """The difference in height beyond which two points lie on two things."""
        return step_m(self.grid.cell_m, self.std_m)

    def pick(self, x_m: float, y_m: float, z_m: float | None, click_m: float) -> Spot | None:
        """The ground at a place, or the point of a given height; None where it is unknown.

        A plane is fitted to the 3x3 cells around. Where they show two layers, as at the edge of a
        coral, the higher one is taken.
        """
        cells = self._cells(x_m, y_m)
        layer = (
            self._highest(cells) if z_m is None else cells[np.abs(cells[:, 2] - z_m) <= self.gap_m]
        )
        if len(layer) < TERRAIN.least_cells:
            return None if z_m is None else self._spot((x_m, y_m, z_m), (0.0, 0.0), click_m)
        height_m, east, north = _plane(layer)
        return self._spot((x_m, y_m, height_m if z_m is None else z_m), (east, north), click_m)

    def _cells(self, x_m: float, y_m: float) -> Array:
        """(N, 3): offsets and heights of the known ones of 3x3 cells."""
        column, row = self.grid.cell(x_m, y_m)
        height, width = self.heights_m.shape
        found = []
        for r in range(max(row - 1, 0), min(row + 2, height)):
            for c in range(max(column - 1, 0), min(column + 2, width)):
                x, y = self.grid.center(c, r)
                found.append((x - x_m, y - y_m, float(self.heights_m[r, c])))
        cells = np.array(found).reshape(-1, 3)
        known: Array = cells[np.isfinite(cells[:, 2])]
        return known

    def _highest(self, cells: Array) -> Array:
        ranked = cells[np.argsort(-cells[:, 2], kind="stable")]
        cuts = [0, *(np.flatnonzero(-np.diff(ranked[:, 2]) > self.gap_m) + 1), len(ranked)]
        layers = [ranked[a:b] for a, b in pairwise(cuts)]
        return next((layer for layer in layers if len(layer) >= TERRAIN.least_cells), cells[:0])

    def _spot(
        self, point_m: tuple[float, float, float], slope: tuple[float, float], click_m: float
    ) -> Spot:
        moved = np.array([(1.0, 0.0, slope[0]), (0.0, 1.0, slope[1])])
        covariance = click_m**2 * moved.T @ moved
        covariance[2, 2] += self.height_std_m(*point_m[:2]) ** 2
        return Spot(np.array(point_m), covariance, self.gap_m, slope)

    def height_std_m(self, x_m: float, y_m: float) -> float:
        """The standard error of a height (mapping/raster/height_errors.py)."""
        column, row = self.grid.cell(x_m, y_m)
        around = self.window(column, row, column, row, RELIEF_CELLS)
        return height_stds(around, RELIEF_CELLS).item()

    def window(self, left: int, top: int, right: int, bottom: int, margin: int = 0) -> Array:
        """The heights from one cell to another with a margin around, NaN off the map."""
        return self._around(self.heights_m, np.nan, left, top, right, bottom, margin)

    def sides_in(self, left: int, top: int, right: int, bottom: int) -> NDArray[np.bool_]:
        """Whether sides were seen, from one cell to another; not off the map."""
        if self.sides is None:
            return np.zeros((bottom - top + 1, right - left + 1), np.bool_)
        return self._around(self.sides, 0.0, left, top, right, bottom, 0) > 0

    def _around(
        self,
        values: NDArray[Any],
        off_map: float,
        left: int,
        top: int,
        right: int,
        bottom: int,
        margin: int,
    ) -> Array:
        height, width = values.shape
        rows, columns = (
            np.arange(low - margin, high + margin + 1)
            for low, high in ((top, bottom), (left, right))
        )
        on_map = ((rows >= 0) & (rows < height))[:, None] & (columns >= 0) & (columns < width)
        inside = np.ix_(np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1))
        return np.where(on_map, values[inside], off_map).astype(np.float64)

    def along(self, spots: Sequence[Spot]) -> list[Spot] | None:
        """Points of the ground along the lines between spots; None where a spot does not lie on it,
        as it is seen from above.
        """
        if not all(self._is_on(spot) for spot in spots):
            return None
        apart_m = max(TERRAIN.step_cells * self.grid.cell_m, TERRAIN.step_stds * self.std_m)
        line = [spots[0]]
        for a, b in pairwise(spots):
            way = b.point_m[:2] - a.point_m[:2]
            count = max(1, int(np.hypot(*way) / apart_m))
            places = a.point_m[:2] + way * np.arange(1, count)[:, None] / count
            between = (self.pick(float(x_m), float(y_m), None, 0.0) for x_m, y_m in places)
            line += [*(spot for spot in between if spot is not None), b]
        return line

    def length(self, spots: Sequence[Spot]) -> Measured | None:
        """Length along the ground; None where ``along`` is. What voxels and matching smooth away is
        put back; half of it is in the standard error.
        """
        line = self.along(spots)
        if line is None:
            return None
        found = length_along(line)
        added_m = TERRAIN.smoothed * max(found.value - straight_length(spots).value, 0.0)
        return Measured(found.value + added_m, float(np.hypot(found.std, added_m / 2)), 1)

    def _is_on(self, spot: Spot) -> bool:
        ground = self.pick(float(spot.point_m[0]), float(spot.point_m[1]), None, 0.0)
        return ground is not None and bool(abs(ground.point_m[2] - spot.point_m[2]) <= self.gap_m)

    def area(self, spots: Sequence[Spot]) -> tuple[Measured, float] | None:
        """Area of the ground inside an outline, and the fraction that is known; what is not, counts
        as the rest.

        It is the area in plan times the mean steepness of planes through 3x3 cells: of what is as
        large as three cells.
        ``metrics`` states the same of outlines.
        None where the outline stands too steep to be seen from above, or nothing is known.
        """
        outline = self.grid.pixels(np.array([spot.point_m for spot in spots]))
        level_m2 = polygon_area(outline) * self.grid.cell_m**2
        planar = planar_area(spots)
        if not level_m2 >= TERRAIN.steepest * planar.value or not all(
            self._is_on(spot) for spot in spots
        ):
            return None
        steepness, stds_m, known = self._inside(outline)
        if not steepness.size:
            return None
        area_m2 = float(steepness.mean()) * level_m2
        relative = np.hypot(planar.std / planar.value, self.steepness_std(steepness, stds_m, known))
        return Measured(area_m2, area_m2 * float(relative), 2), known

    def steepness_std(self, steepness: Array, stds_m: Array, known: float) -> float:
        """Relative standard error of the mean of ``steepness``, by the standard errors of the
        heights, by the roughness that errors of ranges add, and by what is not known.

        Cells finer than ``correlation_m`` show little of what matching smooths away between them.
        """
        stds_cells, sine = stds_m / self.grid.cell_m, np.sqrt(1 - 1 / steepness**2)
        finer = np.sqrt(max(1.0, self.correlation_m / self.grid.cell_m))
        noise = self.std_m**2 / ((2 * self.grid.cell_m) ** 2 + self.correlation_m**2)
        by_heights = np.array(
            [
                TERRAIN.of_slopes * finer * (stds_cells * sine).mean(),
                TERRAIN.of_squares * stds_cells.mean() ** 2,
                TERRAIN.of_noise * noise,
            ]
        )
        unseen = unseen_std(steepness, known)
        return float(np.linalg.norm([*by_heights / steepness.mean(), unseen]))

    def known_area(
        self, places: Sequence[tuple[float, float]], click_m: float
    ) -> tuple[Measured, float] | None:
        """Area of the ground in the part of an outline that is known, and the fraction that it is;
        for corners off the map.
        """
        outline = self.grid.pixels(np.array(places))
        steepness, stds_m, known = self._inside(outline)
        if not steepness.size:
            return None
        area_m2 = float(steepness.mean()) * polygon_area(outline) * self.grid.cell_m**2 * known
        around_m = (
            float(np.hypot(*(outline - np.roll(outline, 1, axis=0)).T).sum()) * self.grid.cell_m
        )
        # to half a cell the edge of what is known is found
        border_m = float(np.hypot(click_m, self.grid.cell_m / 2))
        by_border = border_m * around_m / np.sqrt(len(outline))
        by_heights = area_m2 * self.steepness_std(steepness, stds_m, 1.0)
        return Measured(area_m2, float(np.hypot(by_border, by_heights)), 2), known

    def _inside(self, outline: Array) -> tuple[Array, Array, float]:
        """``steepness`` of the cells inside an outline, in cells; and the known fraction."""
        size = np.array(self.heights_m.shape[::-1])
        low, high = (
            np.ceil(outline.min(axis=0)).astype(int),
            np.floor(outline.max(axis=0)).astype(int),
        )
        total = max(polygon_area(outline), 1.0)
        low, high = np.maximum(low, 0), np.minimum(high, size - 1)
        width, height = np.maximum(high + 1 - low, 0)
        cells = cells_inside([outline], int(low[0]), int(low[1]), (height, width))
        rows, columns = np.nonzero(cells)
        steepness, stds_m = self.steepness(np.stack([columns, rows], axis=-1) + low)
        return steepness, stds_m, min(1.0, len(steepness) / total)

    def steepness(self, cells: NDArray[np.int64]) -> tuple[Array, Array]:
        """(n,) area over level area of planes through 3x3 cells, and (n,) standard errors of the
        heights, at those of the cells (column, row) whose ground is known.

        All layers count, so that the sides of a coral do.
        """
        if not len(cells):
            return np.zeros(0), np.zeros(0)
        (left, top), (right, bottom) = cells.min(axis=0), cells.max(axis=0)
        window = self.window(left, top, right, bottom, RELIEF_CELLS)
        columns, rows = (cells - (left, top) + RELIEF_CELLS).T
        known = np.isfinite(window[rows, columns])
        rows, columns = rows[known], columns[known]
        A, b, _ = (each[rows, columns] for each in plane_sums(window, 1))
        count, size = A[:, 0, 0], A[:, [1, 2], [1, 2]].sum(axis=1) / np.maximum(A[:, 0, 0], 1)
        level = (count < 4) | ~(np.linalg.det(A) > 1e-3 * count**3 * size**2)
        A[level], b[level, 1:] = np.eye(3), 0
        rise_m = np.linalg.solve(A, b[..., None])[:, 1:, 0]
        stds_m = height_stds(window, RELIEF_CELLS)
        steepness = np.hypot(1.0, np.hypot(*rise_m.T) / self.grid.cell_m)
        return steepness, stds_m[rows - RELIEF_CELLS, columns - RELIEF_CELLS]


def _plane(cells: Array) -> tuple[float, float, float]:
    """Height at the middle, and rise to the east and north, of the plane through cells; their mean,
    level, where they span none.
    """
    A = np.column_stack([np.ones(len(cells)), cells[:, :2]])
    normal, size = A.T @ A, float((cells[:, :2] ** 2).sum() / len(cells))
    if len(cells) < 4 or not np.linalg.det(normal) > 1e-3 * len(cells) ** 3 * size**2:
        return float(cells[:, 2].mean()), 0.0, 0.0
    height_m, east, north = np.linalg.solve(normal, A.T @ cells[:, 2])
    return float(height_m), float(east), float(north)
