"""Structure of a site at several scales: mean over squares of an edge, standard deviation among them, and standard error."""

from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.metrics.rdh import rdh
from stereo_seecolor.extras.reef.metrics.redraw import spread_of
from stereo_seecolor.extras.reef.site.mesh import SiteMesh
from stereo_seecolor.extras.reef.site.terrain import Terrain
from stereo_seecolor.extras.reef.site.terrain_errors import TerrainErrors
from stereo_seecolor.mapping.raster.reef_metrics import vector_ruggedness

Array = NDArray[np.float64]

EDGES_M = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
FEWEST_CELLS = 16
"""A square's edge: below it no four scales fit into it."""
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
    """The metrics of all squares of an edge: mean, its standard error from the range errors, standard deviation among squares (NaN
    of one).
    """

    edge_m: float
    squares: int
    mean: Numbers
    standard_error: Numbers
    between_squares: Numbers


def structure(mesh: SiteMesh, terrain: Terrain, errors: TerrainErrors) -> list[StructureAtScale]:
    """Compute the structure at each scale of which the site holds a square."""
    squares = {edge_m: windows for edge_m in EDGES_M if (windows := list(_windows(terrain, edge_m)))}
    area, cell_m = _mesh_area(mesh, terrain), terrain.grid.cell_m

    def of_squares(heights: Array, edge_m: float) -> Array:
        return np.array([_numbers(heights[window], cell_m, area[window]) for window in squares[edge_m]])

    def means(heights: Array) -> Array:
        return np.concatenate([of_squares(heights, edge_m).mean(axis=0) for edge_m in squares])

    if not squares:
        return []
    spread = spread_of(means, terrain, errors).reshape(len(squares), -1)
    return [_summary(edge_m, of_squares(terrain.height_m, edge_m), own) for edge_m, own in zip(squares, spread, strict=True)]


def _summary(edge_m: float, squares: Array, error: Array) -> StructureAtScale:
    """squares: (N, M). error: (M,) of their mean; the mesh's rugosity is known as well as the terrain's."""
    error = error.copy()
    error[Numbers.names().index("mesh_rugosity")] = error[Numbers.names().index("rugosity_area")]
    between = squares.std(axis=0, ddof=1) if len(squares) > 1 else np.full(squares.shape[1], np.nan)
    return StructureAtScale(edge_m, len(squares), Numbers(*squares.mean(axis=0)), Numbers(*error), Numbers(*between))


def _numbers(heights: Array, cell_m: float, area: Array) -> tuple[float, ...]:
    own = rdh(heights, cell_m)
    planar_m2 = float(np.isfinite(heights).sum()) * cell_m**2
    return astuple(
        Numbers(
            own.rugosity_area,
            own.rugosity_hvar,
            own.fractal_dimension,
            own.height_range_m,
            vector_ruggedness(heights, cell_m),
            float(area.sum()) / planar_m2,
        )
    )


def _windows(terrain: Terrain, edge_m: float) -> Iterator[tuple[slice, slice]]:
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
