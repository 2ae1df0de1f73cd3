"""The metrics of a map's squares for the page: without the noise of the heights, at a stated scale,
as ``metrics`` computes them (mapping/raster/noise.py).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.csv_tables import table_rows
from stereo_seecolor.mapping.raster.height_model import Terrain, TerrainErrors
from stereo_seecolor.mapping.raster.noise import Smoothing, averaged, corrected
from stereo_seecolor.mapping.raster.reef_metrics import (
    HORN_CELLS,
    ROUGHNESS,
    ReefMetrics,
    roughness,
)
from stereo_seecolor.mapping.raster.structure import resolved_cells

Array = NDArray[np.float64]
FILE = "reef_metrics.csv"
DRAWS = 8
"""Of errors: standard errors are known to a quarter."""


@dataclass(frozen=True, eq=False)
class Squares:
    """The metrics of each square.

    Attributes:
        scale_m: edge of the cells that heights are averaged over.
        names: of the M metrics.
        rows: (N, 2 + M) x and y of the center, metrics; NaN where unknown.
        std: (N, M) standard errors, NaN where not known.
    """

    scale_m: float
    names: tuple[str, ...]
    rows: Array
    std: Array


def squares_of(table: bytes, terrain: Terrain, errors: TerrainErrors, edge_m: float) -> Squares:
    """The metrics of the squares of a map, without noise.

    Args:
        table: content of reef_metrics.csv, the metrics as mapped.
        terrain: of which they are.
        errors: of its heights.
        edge_m: edge of the squares.

    Raises:
        ValueError, KeyError: the table is damaged.
    """
    rows = [row for row in table_rows(table) if row["square"] != "site"]
    names = ReefMetrics.names()
    values = np.array(
        [[float(row[name] or "nan") for name in ("x_m", "y_m", *names)] for row in rows], np.float64
    ).reshape(len(rows), 2 + len(names))
    cell_m, cells = terrain.grid.cell_m, resolved_cells(terrain, errors)
    size = max(3, round(edge_m / cell_m))
    places = [tuple(map(int, row["square"].split("-"))) for row in rows]
    windows = [
        (slice(row * size, (row + 1) * size), slice(column * size, (column + 1) * size))
        for row, column in places
    ]
    chosen = [names.index(name) for name in ROUGHNESS]

    def measured(heights: Array) -> Array:
        found = _of_windows(heights, windows, cells, cell_m)
        return np.column_stack([found[:, :2] ** 2 - 1, found[:, 2], found[:, 3] ** 2]).ravel()

    def derived(squared: Array) -> Array:
        own = np.maximum(squared.reshape(-1, len(ROUGHNESS)), 0)
        return np.column_stack([np.sqrt(1 + own[:, :2]), own[:, 2], np.sqrt(own[:, 3])]).ravel()

    std = np.full((len(rows), len(names)), np.nan)
    if rows and np.isfinite(errors.noise_m).any():
        found, *stds = corrected(
            measured,
            _smoothing(len(rows)),
            derived,
            terrain.height_m,
            errors.noise_m,
            errors.correlation_m / cell_m,
            cells,
            DRAWS,
        )
        values[:, 2 + np.array(chosen)] = found.reshape(len(rows), -1)
        std[:, chosen] = np.hypot(*stds).reshape(len(rows), -1)
    return Squares(cells * cell_m, names, values, std)


def _of_windows(
    heights: Array, windows: Sequence[tuple[slice, slice]], cells: int, cell_m: float
) -> Array:
    """(N, 4) the ROUGHNESS of squares, from means over ``cells`` x ``cells``; those of one size
    together, since the terrain's border cuts some.
    """
    found, parts = np.empty((len(windows), len(ROUGHNESS))), [heights[one] for one in windows]
    for shape in {part.shape for part in parts}:
        same = [number for number, part in enumerate(parts) if part.shape == shape]
        several = np.array([parts[number] for number in same])
        found[same] = roughness(averaged(several, cells), cells * cell_m)
    return found


def _smoothing(squares: int) -> Smoothing:
    """How the ROUGHNESS of so many squares goes with the scale."""
    kernels, of_ranges = [1, 1, HORN_CELLS, 1], [False, False, False, True]
    return Smoothing(np.tile(kernels, squares), np.tile(of_ranges, squares))
