"""The metrics of a map's squares for the page: those of its table, and in place of the ROUGHNESS
that errors of heights raise, that without the noise of the heights, at a stated scale.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.files.csv_tables import table_rows
from stereo_seecolor.mapping.raster.noise import Smoothing, averaged, corrected
from stereo_seecolor.mapping.raster.reef_metrics import (
    HORN_CELLS,
    ROUGHNESS,
    ReefMetrics,
    roughness,
)
from stereo_seecolor.records import Array

Place = tuple[int, int]
"""Row and column of a square."""
Window = tuple[slice, slice]
FILE = "reef_metrics.csv"
HEIGHT_RANGE = "height_range_m"
"""The metric that is a length, and has the error of the calibration."""


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


def squares_of(
    table: bytes,
    scale_m: float,
    without_noise: Mapping[Place, tuple[Array, Array]],
    calibration: float,
) -> Squares:
    """The metrics of the squares of a map.

    Args:
        table: content of reef_metrics.csv, the metrics as mapped.
        scale_m: edge of the cells that heights are averaged over.
        without_noise: of squares, their ROUGHNESS (4,) and its standard errors (4,).
        calibration: its standard error of a length, relative.

    Raises:
        ValueError, KeyError: the table is damaged.
    """
    rows = [row for row in table_rows(table) if row["square"] != "site"]
    names = ReefMetrics.names()
    values = np.array(
        [[float(row[name] or "nan") for name in ("x_m", "y_m", *names)] for row in rows], np.float64
    ).reshape(len(rows), 2 + len(names))
    std = np.full((len(rows), len(names)), np.nan)
    chosen = [names.index(name) for name in ROUGHNESS]
    for number, row in enumerate(rows):
        of_row, of_column = map(int, row["square"].split("-"))
        if (found := without_noise.get((of_row, of_column))) is not None:
            values[number, [2 + each for each in chosen]], std[number, chosen] = found
    length = names.index(HEIGHT_RANGE)
    std[:, length] = np.hypot(std[:, length], calibration * values[:, 2 + length])
    return Squares(scale_m, names, values, std)


def squared_roughness(
    heights: Array, windows: Sequence[Window], cells: int, cell_m: float
) -> Array:
    """(4 N,) what errors add to, of squares of heights (H, W), from means over ``cells`` x
    ``cells``; those of one size together, since the terrain's border cuts some.
    """
    found, parts = np.empty((len(windows), len(ROUGHNESS))), [heights[one] for one in windows]
    for shape in {part.shape for part in parts}:
        same = [number for number, part in enumerate(parts) if part.shape == shape]
        several = np.array([parts[number] for number in same])
        found[same] = roughness(averaged(several, cells), cells * cell_m)
    return np.column_stack([found[:, :2] ** 2 - 1, found[:, 2], found[:, 3] ** 2]).ravel()


def roughness_without_noise(
    found: Array, correlation_cells: float, cells: int
) -> tuple[Array, Array]:
    """(N, 4) ROUGHNESS of squares and its errors, from ``observed`` of ``squared_roughness``."""

    def derived(squared: Array) -> Array:
        own = np.maximum(squared.reshape(-1, len(ROUGHNESS)), 0)
        return np.column_stack([np.sqrt(1 + own[:, :2]), own[:, 2], np.sqrt(own[:, 3])]).ravel()

    count = found.shape[-1] // len(ROUGHNESS)
    kernels, of_ranges = [1, 1, HORN_CELLS, 1], [False, False, False, True]
    smoothing = Smoothing(np.tile(kernels, count), np.tile(of_ranges, count))
    values, *stds = corrected(found, smoothing, derived, correlation_cells, cells)
    shape = (count, len(ROUGHNESS))
    return values.reshape(shape), np.hypot(*stds).reshape(shape)
