"""Structure of a site at several scales: mean over squares of an edge, standard deviation among
them, and standard error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_errors import OF_EXTREMES, height_stds
from stereo_seecolor.mapping.raster.noise import Smoothing, averaged, corrected, observed
from stereo_seecolor.mapping.raster.reef_metrics import (
    HORN_CELLS,
    surface_rugosity,
    vector_ruggedness,
)
from stereo_seecolor.mapping.raster.square_metrics import (
    dimension,
    dimension_std,
    height_ranges,
    rugosity_hvar,
)
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import Array

Window = tuple[slice, slice]

EDGES_M = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
FEWEST_CELLS = 8
"""A square's edge. The fractal dimension needs 32: four scales of at least four cells."""
DRAWS = 8
"""Of errors; their part of the standard errors, small beside that of the corrections, is known to a
quarter.
"""
RANGE = 3
"""Which of the numbers is the height range."""
SHARED = np.array([0.15, 0.5, 0.5, 0.5, 0.15])
"""Part of the variance of the corrections of each number (the mesh's left out) that is alike in all
squares; the rest averages out. It is larger of those by ranges of heights, to which errors add less
than to slopes. As found on five synthetic reefs.
"""
MIN_COVERAGE = 0.8
"""A square counts if more than this was seen: a hole hides heights and area alike."""


@dataclass(frozen=True)
class Numbers:
    """rugosity_area: area of the surface over its planar area (Jenness 2004). rugosity_hvar,
    fractal_dimension (2 for flat, to 3): see square_metrics.py. height_range_m: highest less
    lowest. vector_ruggedness: see reef_metrics.py. mesh_rugosity: area of the mesh, overhangs and
    noise included, over the planar area; without a standard error.
    """

    rugosity_area: float
    rugosity_hvar: float
    fractal_dimension: float
    height_range_m: float
    vector_ruggedness: float
    mesh_rugosity: float


@dataclass(frozen=True)
class StructureAtScale:
    """The metrics of all squares of an edge: mean, its standard error, standard deviation among
    squares (NaN of one).

    scale_m: edge of the cells over which heights are averaged: of the terrain, or of what matching
    resolves where that is coarser.
    mean: without what errors of ranges add and what matching and voxels smooth away. mapped: what
    the map itself has.
    """

    edge_m: float
    scale_m: float
    squares: int
    mean: Numbers
    standard_error: Numbers
    between_squares: Numbers
    mapped: Numbers

    def with_calibration(self, std: float) -> "StructureAtScale":
        """The same with the calibration's part in the one length. std: of a length, relative."""
        own = self.standard_error
        of_range = float(np.hypot(own.height_range_m, std * self.mean.height_range_m))
        return replace(self, standard_error=replace(own, height_range_m=of_range))


@dataclass(frozen=True, eq=False)
class SitePart:
    """A part of a site, or all of it, with the squares to be measured in it.

    terrain: of the part. coarse: in the cells that are measured, ``cells`` of the terrain's across.
    squares: by the edge, meters, windows of ``coarse``; those of an edge may be none.
    """

    terrain: Terrain
    coarse: Terrain
    cells: int
    squares: dict[float, list[Window]]

    def measured(self, heights: Array) -> Array:
        """Sums over the squares, and of how many, of what ``_layout`` lists of each edge, one after
        the other: (K,), of heights (H, W) of the part.
        """
        own, cell_m = averaged(heights, self.cells), self.coarse.grid.cell_m
        sums = [_sums(own, cell_m, *each) for each in self.squares.items()]
        return np.concatenate(sums)

    def mapped(self, mesh_m2: Array) -> list[Array]:
        """Of each edge, (N, 6) the numbers of its squares as the map has them."""
        return [_with_mesh(self.coarse, mesh_m2, windows) for windows in self.squares.values()]

    def extreme_variances(self) -> Array:
        """(E,) sums over the squares of each edge of the variances of height ranges by what is
        smoothed away at the highest and the lowest place of each (``height_stds``).
        """
        terrain, heights_m = self.terrain, self.coarse.height_m
        height_std_m = np.where(terrain.known, height_stds(terrain.height_m), np.nan)
        std_m = averaged(height_std_m, self.cells)

        def of_square(window: Window) -> float:
            heights, own_m = heights_m[window].ravel(), std_m[window].ravel()
            return float(own_m[np.nanargmax(heights)] ** 2 + own_m[np.nanargmin(heights)] ** 2)

        every = self.squares.values()
        return np.array([sum(of_square(window) for window in windows) for windows in every])


def structure(
    terrain: Terrain,
    errors: TerrainErrors,
    edges_m: Sequence[float] = EDGES_M,
    mesh_m2: Callable[[Grid], Array] | None = None,
) -> list[StructureAtScale]:
    """Compute the structure at each scale of which the site holds a square.

    mesh_m2: the area of mesh over each cell of a grid (H, W); without it its rugosity is NaN.
    """
    cells = resolved_cells(errors.correlation_m, terrain.grid.cell_m)
    coarse = terrain.averaged(cells)
    squares = squares_of(coarse, edges_m)
    if not squares:
        return []
    part = SitePart(terrain, coarse, cells, squares)
    alike_cells = errors.correlation_m / terrain.grid.cell_m
    found = observed(part.measured, terrain.height_m, errors.noise_m, alike_cells, cells, DRAWS)
    area = mesh_m2(coarse.grid) if mesh_m2 else np.full(coarse.grid.shape, np.nan)
    return structure_of(
        tuple(squares),
        coarse.grid.cell_m,
        found,
        part.mapped(area),
        part.extreme_variances(),
        alike_cells,
        cells,
    )


def structure_of(
    edges_m: Sequence[float],
    scale_m: float,
    found: Array,
    mapped: Sequence[Array],
    extremes_m2: Array,
    correlation_cells: float,
    cells: int,
) -> list[StructureAtScale]:
    """The structure at each of the edges (E of them) from what was measured of a site, or of all of
    its parts together.

    Args:
        edges_m: of squares, of each of which there is at least one.
        scale_m: edge of the measured cells.
        found: (1 + DRAWS, 2, K) ``observed`` of ``SitePart.measured``, the sum over the parts.
        mapped: of each edge, ``SitePart.mapped``.
        extremes_m2: (E,) ``SitePart.extreme_variances``, the sum over the parts.
        correlation_cells: length over which errors of heights are alike.
        cells: of the terrain in a measured one.
    """
    edges = [_edges_of_ranges(edge_m, scale_m) for edge_m in edges_m]
    ends = np.cumsum([len(each) + 3 for each in edges])[:-1]
    squared = np.concatenate(
        [_squared(each) for each in np.split(found, 2 * ends, axis=-1)], axis=-1
    )

    def derive(of_all: Array) -> Array:
        return np.concatenate(
            [_derived(each, own) for each, own in zip(edges, np.split(of_all, ends), strict=True)]
        )

    smoothing = Smoothing(
        np.concatenate([[1, HORN_CELLS, 1, *np.ones(len(own))] for own in edges]),
        np.concatenate([[False, False, True, *np.ones(len(own), bool)] for own in edges]),
    )
    values, *parts = corrected(squared, smoothing, derive, correlation_cells, cells)
    values, by_draws, of_corrections = (each.reshape(len(edges), -1) for each in (values, *parts))
    counts = np.array([len(each) for each in mapped])
    alike = np.sqrt(SHARED + (1 - SHARED) / counts[:, None])
    fits = [
        dimension_std(e, np.sqrt(each[3:]))
        for e, each in zip(edges, np.split(squared[0, 0], ends), strict=True)
    ]
    stds = np.hypot(by_draws, alike * of_corrections)
    # by which few things stand out in a square: another one's say nothing of that
    stds[:, 2] = np.hypot(stds[:, 2], fits / np.sqrt(counts))
    values[:, 2] = np.where(np.isfinite(stds[:, 2]), values[:, 2], np.nan)
    stds[:, RANGE] = np.hypot(stds[:, RANGE], OF_EXTREMES * np.sqrt(extremes_m2) / counts)
    return [
        _summary(edge_m, scale_m, own, value, std)
        for edge_m, own, value, std in zip(edges_m, mapped, values, stds, strict=True)
    ]


def _summary(
    edge_m: float, scale_m: float, squares: Array, value: Array, std: Array
) -> StructureAtScale:
    """squares: (N, M) as mapped, the mesh's rugosity last, which stays so: its error is not known.
    value, std: (M - 1,).
    """
    mapped = squares.mean(axis=0)
    between = squares.std(axis=0, ddof=1) if len(squares) > 1 else np.full(squares.shape[1], np.nan)
    return StructureAtScale(
        edge_m,
        scale_m,
        len(squares),
        Numbers(*np.append(value, mapped[-1])),
        Numbers(*np.append(std, np.nan)),
        Numbers(*between),
        Numbers(*mapped),
    )


def resolved_cells(correlation_m: float, cell_m: float) -> int:
    """Cells of a terrain in one that is as coarse as what matching resolves. correlation_m: over
    which errors of heights are alike.
    """
    return max(1, int(np.ceil(correlation_m / cell_m - 1e-6)))


def numbers_of(heights: Array, cell_m: float, windows: list[Window]) -> Array:
    """(N, 5) the numbers of squares, but the mesh's."""
    found = []
    for window in windows:
        edges_m, (area, ruggedness, hvar, *ranges_m) = _of_square(heights[window], cell_m)
        fractal = dimension(edges_m, np.array(ranges_m))
        found.append([area, hvar, fractal, ranges_m[0], ruggedness])
    return np.array(found)


def _of_square(heights: Array, cell_m: float) -> tuple[Array, Array]:
    """Edges of K height ranges; and (3 + K,) rugosity, ruggedness, rugosity by height ranges, and
    these.
    """
    edges_m, ranges_m = height_ranges(heights, cell_m)
    of_surface = surface_rugosity(heights, cell_m), vector_ruggedness(heights, cell_m)
    return edges_m, np.array([*of_surface, rugosity_hvar(edges_m, ranges_m), *ranges_m])


def _edges_of_ranges(edge_m: float, cell_m: float) -> Array:
    """Edges of the squares whose height ranges are measured in squares of an edge."""
    size = round(edge_m / cell_m)
    return height_ranges(np.full((size, size), np.nan), cell_m)[0]


def _sums(heights: Array, cell_m: float, edge_m: float, windows: list[Window]) -> Array:
    """(2 (3 + K),) sums over the squares of an edge of their rugosity, ruggedness, rugosity by
    height ranges and height ranges of K edges; then of how many squares each is known.
    """
    found = np.full((len(windows), 3 + len(_edges_of_ranges(edge_m, cell_m))), np.nan)
    for row, window in zip(found, windows, strict=True):
        row[:] = _of_square(heights[window], cell_m)[1]
    return np.concatenate([np.nansum(found, axis=0), np.isfinite(found).sum(axis=0)])


def _squared(sums: Array) -> Array:
    """(..., 3 + K) what errors add to, from ``_sums`` (..., 2 (3 + K)): squared slopes, ruggedness,
    squared slopes of the finest height ranges, squared height ranges; of means over the squares.
    """
    total, count = np.split(sums, 2, axis=-1)
    means = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    means[..., [0, 2]] = means[..., [0, 2]] ** 2 - 1
    means[..., 3:] **= 2
    return means


def _derived(edges_m: Array, squared: Array) -> Array:
    """(5,) the numbers of squares, but the mesh's, from what ``_squared`` measured."""
    ranges_m = np.sqrt(np.maximum(squared[3:], 0))
    of_area, of_ranges = np.sqrt(1 + np.maximum(squared[[0, 2]], 0))
    fractal = np.clip(dimension(edges_m, ranges_m), 2, 3)
    return np.array([of_area, of_ranges, fractal, ranges_m[0], max(squared[1], 0)])


def _with_mesh(terrain: Terrain, area: Array, windows: list[Window]) -> Array:
    """(N, 6) the numbers of squares as the map has them."""
    cell_m = terrain.grid.cell_m
    mesh = [area[w].sum() / (float(terrain.known[w].sum()) * cell_m**2) for w in windows]
    return np.column_stack([numbers_of(terrain.height_m, cell_m, windows), mesh])


def squares_of(terrain: Terrain, edges_m: Sequence[float] = EDGES_M) -> dict[float, list[Window]]:
    """By edge, meters, the squares that were seen well enough; other edges are left out."""
    found = {edge_m: windows_of(terrain.known, terrain.grid.cell_m, edge_m) for edge_m in edges_m}
    return {edge_m: windows for edge_m, windows in found.items() if windows}


def windows_of(
    known: NDArray[np.bool_],
    cell_m: float,
    edge_m: float,
    first: tuple[int, int] = (0, 0),
    own: Window | None = None,
) -> list[Window]:
    """The squares of an edge that were seen well enough, from a terrain's north-west corner.

    known: (H, W) of the terrain or of a part of it. first: row and column of the part's first cell
    in the terrain. own: only squares whose first cell lies there, in cells of the part.
    """
    size = round(edge_m / cell_m)
    if size < FEWEST_CELLS:
        return []
    within = own or (slice(0, known.shape[0]), slice(0, known.shape[1]))
    rows, columns = (
        range(each.start + (-start - each.start) % size, min(each.stop, length - size + 1), size)
        for each, start, length in zip(within, first, known.shape, strict=True)
    )
    return [
        (slice(row, row + size), slice(column, column + size))
        for row in rows
        for column in columns
        if known[row : row + size, column : column + size].mean() > MIN_COVERAGE
    ]
