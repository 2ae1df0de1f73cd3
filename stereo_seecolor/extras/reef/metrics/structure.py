"""Structure of a site at several scales: mean over squares of an edge, standard deviation among
them, and standard error.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.site.mesh import SiteMesh
from stereo_seecolor.extras.reef.site.terrain import Terrain, TerrainErrors, averaged
from stereo_seecolor.mapping.raster.reef_metrics import surface_rugosity, vector_ruggedness

# Rugosity, fractal dimension and height range of a square, which are geometrically related.
#
# Torres-Pulliza et al. 2020, Nature Ecology & Evolution 4:1495: the mean height range dh(L) of
# squares of edge L grows as L^(3 - D). Their plane: R^2 = dh(L0)^2 / (2 L0^2) + 1 with L0 the
# finest edge. Means of ranges and the logarithmic regression are those of the R package habtools
# (method hvar). Nothing is leveled: a slope counts as height, as it does there.

Heights = NDArray[np.float64]


@dataclass(frozen=True)
class RdhSettings:
    """The scales that are used."""

    # edges of L, L/2, ... L/16, as habtools' documentation suggests: 2, 1, 0.5, 0.25, 0.125 m
    halvings: int = 4
    finest_cells: int = 4  # a height range of fewer cells is too small
    fewest_scales: int = 3  # two always lie on a line


RDH_SETTINGS = RdhSettings()


@dataclass(frozen=True)
class Rdh:
    """The three metrics of a square.

    rugosity_hvar: from height ranges at the finest edge. rugosity_area: area of the surface over
    its planar area (Jenness 2004).
    fractal_dimension: 2 for flat, to 3. height_range_m: highest less lowest. NaN where too little
    was seen.
    """

    rugosity_hvar: float
    rugosity_area: float
    fractal_dimension: float
    height_range_m: float


def rdh(height_m: NDArray[np.floating], cell_m: float) -> Rdh:
    """Measure a square of terrain (H, W), NaN where unknown, at the scales of its edge halved up to
    four times.
    """
    heights = np.asarray(height_m, np.float64)
    edges, ranges = height_ranges(heights, cell_m)
    return Rdh(
        rugosity_hvar=rugosity_hvar(edges, ranges),
        rugosity_area=surface_rugosity(heights, cell_m),
        fractal_dimension=dimension(edges, ranges),
        height_range_m=float(np.nanmax(heights) - np.nanmin(heights))
        if np.isfinite(heights).any()
        else float("nan"),
    )


def height_ranges(heights: Heights, cell_m: float) -> tuple[Heights, Heights]:
    """Edges of squares, from that of all the terrain down, and the mean height range of each: (K,)
    meters.
    """
    edge_m = min(heights.shape) * cell_m
    parts = [
        2**k
        for k in range(RDH_SETTINGS.halvings + 1)
        if edge_m / 2**k >= RDH_SETTINGS.finest_cells * cell_m
    ]
    return edge_m / np.array(parts, np.float64), np.array(
        [mean_height_range(heights, part) for part in parts]
    )


def rugosity_hvar(edges_m: Heights, ranges_m: Heights) -> float:
    """R from the height range at the finest edge."""
    finest = ranges_m[-1] / edges_m[-1] if len(edges_m) else np.nan
    return float(np.sqrt(finest**2 / 2 + 1))


def mean_height_range(heights: Heights, parts: int) -> float:
    """Mean of highest less lowest over parts x parts squares; squares of which less than half is
    known do not count.
    """
    row, column = (np.arange(n) * parts // n for n in heights.shape)
    square = (row[:, None] * parts + column[None, :]).ravel()
    known = np.isfinite(heights).ravel()
    high, low = np.full(parts**2, -np.inf), np.full(parts**2, np.inf)
    np.maximum.at(high, square[known], heights.ravel()[known])
    np.minimum.at(low, square[known], heights.ravel()[known])
    full = np.bincount(square[known], minlength=parts**2) >= 0.5 * np.bincount(
        square, minlength=parts**2
    )
    return float((high - low)[full].mean()) if full.any() else float("nan")


def dimension(edges_m: Heights, ranges_m: Heights) -> float:
    """3 - slope of log range over log edge; a surface without any height is flat."""
    usable = np.isfinite(ranges_m) & (ranges_m > 0)
    if usable.sum() >= RDH_SETTINGS.fewest_scales:
        return 3 - float(np.polyfit(np.log(edges_m[usable]), np.log(ranges_m[usable]), 1)[0])
    return 2.0 if len(ranges_m) and (ranges_m == 0).all() else float("nan")


def dimension_std(edges_m: Heights, ranges_m: Heights) -> float:
    """Standard error of the dimension by how far the ranges lie off a power law; NaN of fewer than
    three.
    """
    usable = np.isfinite(ranges_m) & (ranges_m > 0)
    if usable.sum() < RDH_SETTINGS.fewest_scales:
        return float("nan")
    x, y = np.log(edges_m[usable]), np.log(ranges_m[usable])
    off = y - np.polyval(np.polyfit(x, y, 1), x)
    return float(np.sqrt((off**2).sum() / (len(x) - 2) / ((x - x.mean()) ** 2).sum()))


# Numbers of a terrain without the roughness that errors of ranges add, at the scale of its cells,
# with standard errors.
#
# Two things change what a terrain measures. Errors of the heights roughen it: the number is
# computed again with errors drawn from the terrain's own (each cell's standard error, alike over
# the correlation length), and what these add is taken off (simulation and extrapolation: Cook and
# Stefanski 1994, J. American Statistical Association 89). Matching and voxels smooth it: the
# number is computed again on a terrain that is smoothed further, and continued to the cell as a
# power of the scale, as of a fractal surface. Both corrections are uncertain themselves: a part
# of each is in the standard error.

Array = NDArray[np.float64]
DRAWS = 24
"""The standard error is then itself known to 15 % (1 / sqrt(2 (n - 1)))."""


@dataclass(frozen=True)
class CorrectionSettings:
    """How well the corrections are known, as fractions of themselves."""

    # standard errors of heights are known to some 15 %; extremes of heights grow unlike their
    # squares
    of_noise: float = 0.75
    of_scale: float = 0.5  # no reef is the same fractal at all scales
    smoother: float = (
        2.0  # of the scale that is resolved: far enough to tell how the number goes with it
    )
    of_match: float = (
        0.85  # standard deviation of what matching smooths, in correlation lengths of its errors
    )
    of_voxel: float = 0.5  # and of what voxels smooth, in voxels: both as found on drawn reefs
    # a smoothing of that standard deviation squared, times this, counts as the square of a cell
    steps: float = 4.0
    # power of the scale with which squared slopes fall at most: 1 for a surface of sharp steps
    steepest: float = 1.5


REDRAW_SETTINGS = CorrectionSettings()


def corrected(
    measure: Callable[[Array], Array],
    derive: Callable[[Array], Array],
    terrain: Terrain,
    errors: TerrainErrors,
    scale_m: float,
) -> tuple[Array, Array]:
    """Compute numbers of a terrain without its noise and at a stated scale, and their standard
    errors: (M,) each.

    Args:
        measure: heights (H, W) -> (K,), to which errors and scales add: squares of slopes and of
        ranges of heights.
        derive: (K,) -> (M,), the numbers.
        terrain: its heights are measured. Cells whose standard error is unknown stay as they are.
        errors: standard errors of its heights, and the length over which they are correlated, which
        is also how finely
            matching resolves.
        scale_m: edge of the cells that ``measure`` averages heights over.
    """
    cell_m = terrain.grid.cell_m
    smoothing_m = np.hypot(
        REDRAW_SETTINGS.of_match * errors.correlation_m, REDRAW_SETTINGS.of_voxel * cell_m
    )
    resolved_m = float(np.sqrt(scale_m**2 + REDRAW_SETTINGS.steps * smoothing_m**2))
    blur_cells = (
        resolved_m
        / cell_m
        * float(np.sqrt((REDRAW_SETTINGS.smoother**2 - 1) / REDRAW_SETTINGS.steps))
    )

    def both(heights: Array) -> Array:
        return np.array([measure(heights), measure(smoothed(heights, blur_cells))])

    noises = _noises(errors.noise_m, errors.correlation_m / cell_m, DRAWS // 2)
    mapped = both(terrain.height_m)
    draws = np.array(
        [both(terrain.height_m + sign * noise) for noise in noises for sign in (1, -1)]
    )  # what is odd cancels
    fine, coarse = 2 * mapped - draws.mean(axis=0)
    falls = np.divide(
        fine,
        coarse,
        out=np.ones_like(fine),
        where=(coarse * fine > 0) & (np.abs(coarse) < np.abs(fine)),
    )
    falls = np.minimum(falls, REDRAW_SETTINGS.smoother**REDRAW_SETTINGS.steepest)
    sharp = fine * falls ** (np.log(resolved_m / scale_m) / np.log(REDRAW_SETTINGS.smoother))
    raw, smooth, values = derive(mapped[0]), derive(fine), derive(sharp)
    noise, scale = (
        REDRAW_SETTINGS.of_noise * (raw - smooth),
        REDRAW_SETTINGS.of_scale * (values - smooth),
    )
    by_draws = np.array([derive(draw) for draw in draws[:, 0]]).std(axis=0, ddof=1)
    return values, np.linalg.norm([by_draws, noise, scale], axis=0)


def spread_of(measure: Callable[[Array], Array], terrain: Terrain, errors: TerrainErrors) -> Array:
    """Compute the standard deviation, (M,), of ``measure`` (heights (H, W) -> (M,)) over DRAWS
    draws of the terrain's errors.
    """
    noises = _noises(errors.std_m, errors.correlation_m / terrain.grid.cell_m, DRAWS)
    return np.asarray(
        np.array([measure(terrain.height_m + noise) for noise in noises]).std(axis=0, ddof=1)
    )


def _noises(std_m: Array, correlation_cells: float, count: int) -> Iterator[Array]:
    """Draws of errors (H, W) of heights; 0 where their standard error is unknown."""
    rng, sigma = np.random.default_rng(0), correlation_cells / float(np.sqrt(2))
    return (_noise(std_m.shape, sigma, rng) * np.nan_to_num(std_m) for _ in range(count))


def smoothed(heights: Array, sigma: float) -> Array:
    """Heights (H, W) after a Gaussian of ``sigma`` cells; what is unknown stays so, and counts for
    nothing.
    """
    known, size = np.isfinite(heights), (2 * int(np.ceil(3 * sigma)) + 1,) * 2
    weight = cv2.GaussianBlur(known.astype(np.float64), size, sigma, borderType=cv2.BORDER_CONSTANT)
    total = cv2.GaussianBlur(
        np.where(known, heights, 0), size, sigma, borderType=cv2.BORDER_CONSTANT
    )
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)


def _noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of unit variance, correlated as exp(-d^2 / (4 sigma^2)), cells."""
    noise = rng.standard_normal(shape)
    if sigma < 0.3:
        return noise
    size = 2 * int(np.ceil(3 * sigma)) + 1
    kernel = cv2.getGaussianKernel(size, sigma)
    return np.asarray(cv2.sepFilter2D(noise, -1, kernel, kernel) / float((kernel**2).sum()))


Window = tuple[slice, slice]

EDGES_M = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
FEWEST_CELLS = 8
"""A square's edge. The fractal dimension needs 16: three scales of at least four cells."""
MIN_COVERAGE = 0.8
"""A square counts if more than this fraction of it was seen: a hole hides heights and area
alike.
"""


@dataclass(frozen=True)
class Numbers:
    """See ``rdh`` and reef_metrics.py. mesh_rugosity: area of the mesh, overhangs included, over
    the planar area.
    """

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
        return np.concatenate(
            [_derived(each, own) for each, own in zip(edges, np.split(squared, ends), strict=True)]
        )

    found = corrected(measure, derive, terrain, errors, scale_m)
    values, stds = (each.reshape(len(squares), -1) for each in found)
    fits = [
        dimension_std(e, np.sqrt(each[2:]))
        for e, each in zip(edges, np.split(measure(terrain.height_m), ends), strict=True)
    ]
    stds[:, 2] = np.hypot(stds[:, 2], fits)
    area = _mesh_area(mesh, coarse)
    return [
        _summary(edge_m, scale_m, _with_mesh(coarse, area, windows), value, std)
        for (edge_m, windows), value, std in zip(squares.items(), values, stds, strict=True)
    ]


def _summary(
    edge_m: float, scale_m: float, squares: Array, value: Array, std: Array
) -> StructureAtScale:
    """squares: (N, M) as mapped, the mesh's rugosity last. value, std: (M - 1,); the mesh's is
    corrected as the terrain's.
    """
    mapped = squares.mean(axis=0)
    mean = np.append(value, mapped[-1] * value[0] / mapped[0])
    between = squares.std(axis=0, ddof=1) if len(squares) > 1 else np.full(squares.shape[1], np.nan)
    return StructureAtScale(
        edge_m,
        scale_m,
        len(squares),
        Numbers(*mean),
        Numbers(*np.append(std, std[0])),
        Numbers(*between),
        Numbers(*mapped),
    )


def resolved_cells(terrain: Terrain, errors: TerrainErrors) -> int:
    """Cells of the terrain in one that is as coarse as what matching resolves."""
    return max(1, int(np.ceil(errors.correlation_m / terrain.grid.cell_m - 1e-6)))


def numbers_of(heights: Array, cell_m: float, windows: list[Window]) -> Array:
    """(N, 5) the numbers of squares, but the mesh's."""
    return np.array(
        [
            (*_of_rdh(rdh(heights[w], cell_m)), vector_ruggedness(heights[w], cell_m))
            for w in windows
        ]
    )


def _squared(heights: Array, cell_m: float, windows: list[Window]) -> Array:
    """(2 + K,) what errors add to: squared slopes, ruggedness, squared height ranges of K edges;
    means over the squares.
    """
    parts = [heights[w] for w in windows]
    ranges = np.array([height_ranges(part, cell_m)[1] for part in parts])
    slopes = np.mean([surface_rugosity(part, cell_m) for part in parts]) ** 2 - 1
    return np.array(
        [
            slopes,
            np.mean([vector_ruggedness(part, cell_m) for part in parts]),
            *np.nanmean(ranges, axis=0) ** 2,
        ]
    )


def _derived(edges_m: Array, squared: Array) -> Array:
    """(5,) the numbers of squares, but the mesh's, from what ``_squared`` measured."""
    ranges_m = np.sqrt(np.maximum(squared[2:], 0))
    rugosity = float(np.sqrt(1 + max(squared[0], 0)))
    fractal = np.clip(dimension(edges_m, ranges_m), 2, 3)
    return np.array(
        [rugosity, rugosity_hvar(edges_m, ranges_m), fractal, ranges_m[0], max(squared[1], 0)]
    )


def _of_rdh(own: Rdh) -> tuple[float, ...]:
    return own.rugosity_area, own.rugosity_hvar, own.fractal_dimension, own.height_range_m


def _with_mesh(terrain: Terrain, area: Array, windows: list[Window]) -> Array:
    """(N, 6) the numbers of squares as the map has them."""
    cell_m = terrain.grid.cell_m
    mesh = [area[w].sum() / (float(terrain.known[w].sum()) * cell_m**2) for w in windows]
    return np.column_stack([numbers_of(terrain.height_m, cell_m, windows), mesh])


def squares_of(terrain: Terrain) -> dict[float, list[Window]]:
    """By the edge, meters, the squares that were seen well enough; edges without one are left
    out.
    """
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
    return np.asarray(
        np.bincount(row * width + column, area_m2, height * width).reshape(height, width)
    )
