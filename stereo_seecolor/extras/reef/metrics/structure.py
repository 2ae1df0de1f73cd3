"""Structure of a site at several scales: mean over squares of an edge, standard deviation among them, and standard error."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.metrics.rdh import Rdh, dimension, dimension_std, height_ranges, rdh, rugosity_hvar
from stereo_seecolor.extras.reef.metrics.redraw import corrected
from stereo_seecolor.extras.reef.site.mesh import SiteMesh
from stereo_seecolor.extras.reef.site.terrain import Terrain, averaged
from stereo_seecolor.extras.reef.site.terrain_errors import TerrainErrors
from stereo_seecolor.mapping.raster.reef_metrics import surface_rugosity, vector_ruggedness

Array = NDArray[np.float64]
Window = tuple[slice, slice]

EDGES_M = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
FEWEST_CELLS = 8
"""A square's edge. The fractal dimension needs 16: three scales of at least four cells."""
MIN_COVERAGE = 0.8
"""A square counts if more than this fraction of it was seen: a hole hides heights and area alike."""


@dataclass(frozen=True)
class Numbers:
    """See ``rdh`` and reef_metrics.py. mesh_rugosity: area of the mesh, overhangs included, over the planar area."""

    rugosity_area: float
    rugosity_hvar: float
    fractal_dimension: float
    height_range_m: float
    vector_ruggedness: float
    mesh_rugosity: float

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the metrics, in the order of the fields."""
        return tuple(field.name for field in fields(cls))


@dataclass(frozen=True)
class StructureAtScale:
    """The metrics of all squares of an edge: mean, its standard error, standard deviation among squares (NaN of one).

    scale_m: edge of the cells over which heights are averaged: of the terrain, or of what matching resolves where that is coarser.
    mean: without what errors of ranges add and what matching and voxels smooth away. mapped: what the map itself has.
    """

    edge_m: float
    scale_m: float
    squares: int
    mean: Numbers
    standard_error: Numbers
    between_squares: Numbers
    mapped: Numbers


def structure(mesh: SiteMesh, terrain: Terrain, errors: TerrainErrors) -> list[StructureAtScale]:
    """Compute the structure at each scale of which the site holds a square."""
    cells = resolved_cells(terrain, errors)
    coarse = terrain.averaged(cells)
    squares, scale_m = squares_of(coarse), coarse.grid.cell_m
    if not squares:
        return []

    edges = [height_ranges(coarse.height_m[windows[0]], scale_m)[0] for windows in squares.values()]
    ends = np.cumsum([len(each) + 2 for each in edges])[:-1]

    def measure(heights: Array) -> Array:
        own = averaged(heights, cells)
        return np.concatenate([_squared(own, scale_m, windows) for windows in squares.values()])

    def derive(squared: Array) -> Array:
        return np.concatenate([_derived(each, own) for each, own in zip(edges, np.split(squared, ends), strict=True)])

    found = corrected(measure, derive, terrain, errors, scale_m)
    values, stds = (each.reshape(len(squares), -1) for each in found)
    fits = [dimension_std(e, np.sqrt(each[2:])) for e, each in zip(edges, np.split(measure(terrain.height_m), ends), strict=True)]
    stds[:, 2] = np.hypot(stds[:, 2], fits)
    area = _mesh_area(mesh, coarse)
    return [
        _summary(edge_m, scale_m, _with_mesh(coarse, area, windows), value, std)
        for (edge_m, windows), value, std in zip(squares.items(), values, stds, strict=True)
    ]


def _summary(edge_m: float, scale_m: float, squares: Array, value: Array, std: Array) -> StructureAtScale:
    """squares: (N, M) as mapped, the mesh's rugosity last. value, std: (M - 1,); the mesh's is corrected as the terrain's."""
    mapped = squares.mean(axis=0)
    mean = np.append(value, mapped[-1] * value[0] / mapped[0])
    between = squares.std(axis=0, ddof=1) if len(squares) > 1 else np.full(squares.shape[1], np.nan)
    return StructureAtScale(
        edge_m, scale_m, len(squares), Numbers(*mean), Numbers(*np.append(std, std[0])), Numbers(*between), Numbers(*mapped)
    )


def resolved_cells(terrain: Terrain, errors: TerrainErrors) -> int:
    """Cells of the terrain in one that is as coarse as what matching resolves."""
    return max(1, int(np.ceil(errors.correlation_m / terrain.grid.cell_m - 1e-6)))


def numbers_of(heights: Array, cell_m: float, windows: list[Window]) -> Array:
    """(N, 5) the numbers of squares, but the mesh's."""
    return np.array([(*_of_rdh(rdh(heights[w], cell_m)), vector_ruggedness(heights[w], cell_m)) for w in windows])


def _squared(heights: Array, cell_m: float, windows: list[Window]) -> Array:
    """(2 + K,) what errors add to: squared slopes, ruggedness, squared height ranges of K edges; means over the squares."""
    parts = [heights[w] for w in windows]
    ranges = np.array([height_ranges(part, cell_m)[1] for part in parts])
    slopes = np.mean([surface_rugosity(part, cell_m) for part in parts]) ** 2 - 1
    return np.array([slopes, np.mean([vector_ruggedness(part, cell_m) for part in parts]), *np.nanmean(ranges, axis=0) ** 2])


def _derived(edges_m: Array, squared: Array) -> Array:
    """(5,) the numbers of squares, but the mesh's, from what ``_squared`` measured."""
    ranges_m = np.sqrt(np.maximum(squared[2:], 0))
    rugosity = float(np.sqrt(1 + max(squared[0], 0)))
    fractal = np.clip(dimension(edges_m, ranges_m), 2, 3)
    return np.array([rugosity, rugosity_hvar(edges_m, ranges_m), fractal, ranges_m[0], max(squared[1], 0)])


def _of_rdh(own: Rdh) -> tuple[float, ...]:
    return own.rugosity_area, own.rugosity_hvar, own.fractal_dimension, own.height_range_m


def _with_mesh(terrain: Terrain, area: Array, windows: list[Window]) -> Array:
    """(N, 6) the numbers of squares as the map has them."""
    cell_m = terrain.grid.cell_m
    mesh = [area[w].sum() / (float(terrain.known[w].sum()) * cell_m**2) for w in windows]
    return np.column_stack([numbers_of(terrain.height_m, cell_m, windows), mesh])


def squares_of(terrain: Terrain) -> dict[float, list[Window]]:
    """By the edge, meters, the squares that were seen well enough; edges without one are left out."""
    return {edge_m: windows for edge_m in EDGES_M if (windows := list(_windows(terrain, edge_m)))}


def _windows(terrain: Terrain, edge_m: float) -> Iterator[Window]:
    """The squares of an edge that were seen well enough, from the terrain's north-west corner."""
    size = round(edge_m / terrain.grid.cell_m)
    if size < FEWEST_CELLS:
        return
    height, width = terrain.grid.shape
    for row in range(0, height - size + 1, size):
        for column in range(0, width - size + 1, size):
            window = slice(row, row + size), slice(column, column + size)
            if terrain.known[window].mean() > MIN_COVERAGE:
                yield window


def _mesh_area(mesh: SiteMesh, terrain: Terrain) -> Array:
    """(H, W) square meters of mesh over, and below, each cell."""
    (row, column, area_m2), (height, width) = terrain.triangles_of(mesh), terrain.grid.shape
    return np.asarray(np.bincount(row * width + column, area_m2, height * width).reshape(height, width))
