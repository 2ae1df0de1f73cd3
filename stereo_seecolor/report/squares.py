"""The metrics of a map's squares for the page: without the noise of the heights, at a stated scale.

As ``metrics`` computes them cell by cell (mapping/raster/noise.py), from what a finished run knows
without reading its ranges again: the standard error of a typical range, and how often a spot was
seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.csv_tables import table_rows
from stereo_seecolor.mapping.raster.noise import Smoothing, averaged, corrected
from stereo_seecolor.mapping.raster.reef_metrics import (
    HORN_CELLS,
    ROUGHNESS,
    ReefMetrics,
    roughness,
)
from stereo_seecolor.run_folder.posed_run import MATCH_PX

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
        rugosity, rugosity_std: surface rugosity of all squares, weighted by what was seen of each.
    """

    scale_m: float
    names: tuple[str, ...]
    rows: Array
    std: Array
    rugosity: float
    rugosity_std: float


def squares_of(
    table: bytes, heights_m: Array, cell_m: float, edge_m: float, noise_m: float, pixel_m: float
) -> Squares:
    """The metrics of the squares of a map, without noise.

    Args:
        table: content of reef_metrics.csv, the metrics as mapped.
        heights_m: (H, W) the terrain, NaN where unknown.
        cell_m: edge of its cells.
        edge_m: edge of the squares.
        noise_m: standard error of a height by noise, all views of it together.
        pixel_m: edge of a pixel on the bottom.

    Raises:
        ValueError, KeyError: the table is damaged.
    """
    rows = [row for row in table_rows(table) if row["square"] != "site"]
    names = ReefMetrics.names()
    values = np.array(
        [[float(row[name] or "nan") for name in ("x_m", "y_m", *names)] for row in rows], np.float64
    ).reshape(len(rows), 2 + len(names))
    size = max(3, round(edge_m / cell_m))
    cells = max(1, int(np.ceil(MATCH_PX * pixel_m / cell_m - 1e-6)))
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
        own = np.column_stack([np.sqrt(1 + own[:, :2]), own[:, 2], np.sqrt(own[:, 3])])
        return np.append(own, [_mean(own, seen)], axis=0).ravel()

    std, seen = np.full((len(rows) + 1, len(names)), np.nan), values[:, 2]
    values = np.append(values, np.full((1, 2 + len(names)), np.nan), axis=0)
    values[-1, 2 + np.array(chosen)] = _mean(values[:-1, 2 + np.array(chosen)], seen)
    if rows and np.isfinite(noise_m):
        noise = np.full(heights_m.shape, noise_m)
        found, *stds = corrected(
            measured,
            _smoothing(len(rows)),
            derived,
            heights_m,
            noise,
            MATCH_PX * pixel_m / cell_m,
            cells,
            DRAWS,
        )
        values[:, 2 + np.array(chosen)] = found.reshape(len(values), -1)
        std[:, chosen] = np.hypot(*stds).reshape(len(values), -1)
    site = float(values[-1, 2 + chosen[0]]), float(std[-1, chosen[0]])
    return Squares(cells * cell_m, names, values[:-1], std[:-1], *site)


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


def _mean(own: Array, seen: Array) -> Array:
    """(M,) mean over squares (N, M), weighted by the fraction of each that was seen."""
    weight = np.where(np.isfinite(own), seen[:, None], 0)
    with np.errstate(invalid="ignore"):
        return np.asarray((weight * np.nan_to_num(own)).sum(axis=0) / weight.sum(axis=0))
