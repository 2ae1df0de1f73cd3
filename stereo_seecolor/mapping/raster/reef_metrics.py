"""Metrics of a reef's structure as ecologists compute them, on a terrain model, for each square and
for the whole site.

surface_rugosity: area of the surface over its planar area, 8 triangles a cell (Jenness 2004,
Wildlife Society Bulletin 32).
linear_rugosity: length of the profile over the straight line, mean of all east-west and north-south
profiles of a square
  (chain and tape; Risk 1972, Atoll Research Bulletin 153).
slope_deg, aspect_deg: of the plane through a square's cells; aspect is where it faces, clockwise
from north.
vector_ruggedness: 1 - length of the mean unit normal (VRM; Sappington, Longshore and Thompson 2007,
J. Wildlife Management 71),
  normals by Horn's 3x3 gradient (1981, Proc. IEEE 69).
fractal_dimension: 2 - the slope of log surface area over log cell size, cells of 1 to 16 times the
terrain's
  (Zawada and Brock 2009, J. Coastal Research SI 53); 2 is flat.
height_range_m: highest less lowest cell, after the plane was taken out.
"""

from dataclasses import astuple, dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid

MIN_COVERAGE = 0.5
"""Fraction of a square's cells that must be known."""
HORN_CELLS = float(np.sqrt(3.5))
"""Edge of what the slopes of vector ruggedness average over: along them two cells, across them a
cell under the weights 1, 2, 1, of variance one half (root mean square of 2 and of the root of 3).
"""
_SCALES = (1, 2, 4, 8, 16)
"""Cell sizes of the fractal dimension, in cells of the terrain."""

Heights = NDArray[np.float64]


@dataclass(frozen=True)
class ReefMetrics:
    """Metrics of a square or a site; NaN: too little seen. coverage: fraction of cells seen."""

    coverage: float
    surface_rugosity: float
    linear_rugosity: float
    slope_deg: float
    aspect_deg: float
    vector_ruggedness: float
    fractal_dimension: float
    height_range_m: float

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the metrics, in the order of ``values``."""
        return tuple(field.name for field in fields(cls))

    def values(self) -> tuple[float, ...]:
        """All metrics, in the order of the fields."""
        return tuple(astuple(self))


def measure(height_m: NDArray[np.floating], cell_m: float) -> ReefMetrics:
    """The metrics of a terrain model (H, W), NaN if unknown; see this module's docstring."""
    heights = np.asarray(height_m, np.float64)
    coverage = float(_coverage(heights))
    if coverage < MIN_COVERAGE or min(heights.shape) < 3:
        return ReefMetrics(coverage, *([float("nan")] * 7))
    east, north, residual = _plane(heights, cell_m)
    surface, linear, ruggedness, range_m = map(float, _roughness(heights, residual, cell_m))
    return ReefMetrics(
        coverage=coverage,
        surface_rugosity=surface,
        linear_rugosity=linear,
        slope_deg=float(np.degrees(np.arctan(np.hypot(east, north)))),
        aspect_deg=float(np.degrees(np.arctan2(-east, -north)) % 360),
        vector_ruggedness=ruggedness,
        fractal_dimension=_fractal_dimension(heights, cell_m),
        height_range_m=range_m,
    )


ROUGHNESS = ("surface_rugosity", "linear_rugosity", "vector_ruggedness", "height_range_m")
"""What ``roughness`` measures: the metrics that errors of heights raise."""


def roughness(heights: Heights, cell_m: float) -> Heights:
    """(..., 4) the metrics ROUGHNESS of squares of terrain (..., H, W); NaN if seen little."""
    if min(heights.shape[-2:]) < 3:
        return np.full((*heights.shape[:-2], len(ROUGHNESS)), np.nan)
    found = _roughness(heights, _plane(heights, cell_m)[2], cell_m)
    return np.where((_coverage(heights) >= MIN_COVERAGE)[..., None], found, np.nan)


def _roughness(heights: Heights, residual: Heights, cell_m: float) -> Heights:
    """residual: the heights without their plane."""
    known = np.isfinite(residual)
    highest = np.where(known, residual, -np.inf).max(axis=(-2, -1))
    lowest = np.where(known, residual, np.inf).min(axis=(-2, -1))
    measured = (
        surface_rugosity(heights, cell_m),
        _linear_rugosity(heights, cell_m),
        vector_ruggedness(heights, cell_m),
        highest - lowest,
    )
    return np.stack(measured, axis=-1)


def _coverage(heights: Heights) -> Any:
    """(...) fraction of the cells (..., H, W) that are known."""
    return np.isfinite(heights).sum(axis=(-2, -1)) / max(heights.shape[-2] * heights.shape[-1], 1)


def _mean_known(values: Heights) -> Any:
    """(...) mean of the known ones of (..., H, W); NaN where none is."""
    known = np.isfinite(values)
    total, number = np.where(known, values, 0).sum(axis=(-2, -1)), known.sum(axis=(-2, -1))
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def measure_squares(terrain: BlockRaster, square_m: float, folder: Path) -> BlockRaster:
    """Measure all squares of a terrain model, of edge ``square_m``, that were seen: (metrics, rows,
    columns) float32.

    Squares are counted from the terrain's north-west corner. folder: where blocks are written.
    """
    cell_m = terrain.grid.cell_m
    size = max(3, round(square_m / cell_m))
    shape = -(-terrain.grid.shape[0] // size), -(-terrain.grid.shape[1] // size)
    grid = Grid(terrain.grid.west_m, terrain.grid.north_m, size * cell_m, shape)
    squares = BlockRaster(folder, grid, len(ReefMetrics.names()), np.float32, np.nan)
    wanted = {
        place
        for window in terrain.windows()
        for place in product(*(range(side.start // size, -(-side.stop // size)) for side in window))
    }
    for row, column in sorted(wanted):
        heights = terrain.read(
            slice(row * size, (row + 1) * size), slice(column * size, (column + 1) * size)
        )[0]
        values = np.array(measure(heights, cell_m).values(), np.float32)
        if values[0] > 0:
            squares.write(slice(row, row + 1), slice(column, column + 1), values[:, None, None])
    return squares


def site_of(squares: NDArray[np.floating]) -> NDArray[np.float64]:
    """Average the metrics of a site's squares (metrics, N), weighted by coverage: (metrics,)."""
    values = np.asarray(squares, np.float64)
    known = np.isfinite(values[1])
    if not known.any():
        return np.full(len(values), np.nan)
    site = np.average(values[:, known], axis=1, weights=values[0, known])
    site[0] = values[0].mean()
    aspect = ReefMetrics.names().index("aspect_deg")
    directions = np.exp(1j * np.radians(values[aspect, known])) * values[0, known]
    site[aspect] = np.degrees(np.angle(directions.sum())) % 360
    return site


def _plane(heights: Heights, cell_m: float) -> tuple[Any, Any, Heights]:
    """Rise to the east and to the north of the fitted plane (...), and what is left of the heights
    (..., H, W) without it.
    """
    known = np.isfinite(heights)
    rows, columns = np.mgrid[: heights.shape[-2], : heights.shape[-1]] * cell_m
    away = [
        np.where(known, values - _mean_known(np.where(known, values, np.nan))[..., None, None], 0)
        for values in (columns, -rows, heights)
    ]
    product = np.array([[(a * b).sum(axis=(-2, -1)) for a in away] for b in away[:2]])
    normal = np.moveaxis(product, (0, 1), (-2, -1))
    rise = (np.linalg.pinv(normal[..., :2], hermitian=True) @ normal[..., 2:])[..., 0]
    east, north = rise[..., 0], rise[..., 1]
    plane = east[..., None, None] * away[0] + north[..., None, None] * away[1]
    return east, north, np.where(known, away[2] - plane, np.nan)


def surface_rugosity(heights: Heights, cell_m: float) -> Any:
    """(...) area of surfaces (..., H, W) over their planar area; NaN without four known neighbors.

    Between each four neighbors lie two triangles; both ways to halve the square are averaged.
    """
    upper, lower = heights[..., :-1, :], heights[..., 1:, :]
    a, b, c, d = upper[..., :-1], upper[..., 1:], lower[..., :-1], lower[..., 1:]
    area = np.zeros(a.shape)
    for right, down in ((b - a, c - a), (d - c, d - b), (b - a, d - b), (d - c, c - a)):
        area += 0.25 * cell_m * np.sqrt(cell_m**2 + right**2 + down**2)
    return _mean_known(area) / cell_m**2


def _linear_rugosity(heights: Heights, cell_m: float) -> Any:
    steps = [np.hypot(np.diff(heights, axis=axis), cell_m) / cell_m for axis in (-2, -1)]
    return (_mean_known(steps[0]) + _mean_known(steps[1])) / 2


def vector_ruggedness(heights: Heights, cell_m: float) -> Any:
    """(...) 1 - length of the mean unit normal of (..., H, W) (Sappington et al. 2007); NaN where
    no cell has all its neighbors.
    """
    across = heights[..., 2:] - heights[..., :-2]
    down = heights[..., :-2, :] - heights[..., 2:, :]
    rise_x = (across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]) / (8 * cell_m)
    rise_y = (down[..., :-2] + 2 * down[..., 1:-1] + down[..., 2:]) / (8 * cell_m)
    length = np.sqrt(1 + rise_x**2 + rise_y**2)
    mean = [_mean_known(part / length) for part in (-rise_x, -rise_y, np.ones_like(rise_x))]
    return 1 - np.sqrt(sum(np.square(part) for part in mean))


def _fractal_dimension(heights: Heights, cell_m: float) -> float:
    sizes, areas = [], []
    for scale in _SCALES:
        coarse = heights[::scale, ::scale]
        if min(coarse.shape) < 4:
            break
        rugosity = surface_rugosity(coarse, cell_m * scale)
        if np.isfinite(rugosity):
            sizes.append(np.log(cell_m * scale))
            areas.append(np.log(rugosity))
    return float(2 - np.polyfit(sizes, areas, 1)[0]) if len(sizes) >= 3 else float("nan")
