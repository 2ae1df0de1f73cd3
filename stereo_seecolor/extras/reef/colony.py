"""Measures of a colony, or of anything that an outline encloses: planar area, surface area, height
and volume above the ground around it.
"""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from stereo_seecolor.extras.reef.ground_volume import RIM_CELLS, rim_of, rim_plane, volume_of
from stereo_seecolor.extras.reef.lengths_and_areas import Measured, planar_area
from stereo_seecolor.extras.reef.map_ground import Ground
from stereo_seecolor.extras.reef.outlines import Outline
from stereo_seecolor.extras.reef.polygons import inside, polygon_area
from stereo_seecolor.extras.reef.site_surface import SiteMesh
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_errors import OF_EXTREMES, height_stds
from stereo_seecolor.mapping.raster.noise import peaks, spread_of
from stereo_seecolor.mapping.raster.sides import sides_seen
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import Array, Mask


@dataclass(frozen=True)
class ColonySize:
    """Square meters, meters and liters.

    planar_m2: in plan. tilted_m2: of the flat polygon through the outline's corners on the ground;
    NaN where one is not known.
    surface_m2: of planes through 3x3 cells. mesh_m2: of the mesh, noise and overhangs included.
    height_m: of the highest place above the plane through the rim, without what noise adds and
    smoothing takes.
    volume_l: above that plane; NaN where it is not positive. rugosity: surface over planar area.
    The page and ``measure`` state the same areas and the same volume.
    """

    planar_m2: float
    tilted_m2: float
    surface_m2: float
    mesh_m2: float
    height_m: float
    volume_l: float
    rugosity: float


@dataclass(frozen=True)
class Colony:
    """The measures of an outline, with standard errors from the range errors; unseen: fraction of
    its cells without a surface.

    views: mean number of frames behind a cell. counted: mean, over its cells, of 1 over the
    outlines that hold the cell, so that outlines that overlap count their common cells once
    together.
    """

    name: str
    label: str
    measured: ColonySize
    standard_error: ColonySize
    unseen: float
    views: float
    counted: float = 1.0


def measure_outlines(
    outlines: Sequence[Outline],
    mesh: SiteMesh,
    terrain: Terrain,
    errors: TerrainErrors,
    height_std_m: float,
    click_m: float = 0.0,
    calibration: float = 0.0,
    alike_m: float | None = None,
) -> list[Colony | None]:
    """Measure each outline; None where nothing of it was seen.

    height_std_m: of a height, click_m: of a corner, calibration: of a length, relative; alike_m:
    the distance over which errors of heights are alike, that of ``errors`` if None; as the page has
    them.
    """
    masks = [outline.mask(terrain.grid) for outline in outlines]
    seen = [i for i, mask in enumerate(masks) if (mask & terrain.known).any()]
    if not seen:
        return [None] * len(outlines)
    windows = {i: _window(masks[i]) for i in seen}
    holders = np.asarray(sum(mask.astype(np.int32) for mask in masks))

    def by_terrain(heights: Array) -> Array:
        parts = [(heights[windows[i]], masks[i][windows[i]]) for i in seen]
        return np.array([height_above(own, inside) for own, inside in parts])

    grid = terrain.grid
    correlation_m = errors.correlation_m if alike_m is None else alike_m
    heights = terrain.height_m.astype(np.float32)
    ground = Ground(heights, grid, height_std_m, correlation_m=correlation_m)
    mesh_m2 = mesh.area_over(grid)
    sides = sides_seen(terrain.height_m, mesh_m2, grid.cell_m, ground.gap_m)
    ground = replace(ground, sides=sides)
    heights_m, height_stds_m = _peaks(by_terrain, terrain, errors)
    colonies: list[Colony | None] = [None] * len(outlines)
    for i, height_m, height_std in zip(seen, heights_m, height_stds_m, strict=True):
        known = masks[i] & terrain.known
        fraction = float(known.sum() / _cells_of(outlines[i], masks[i], grid))
        areas, area_stds, relative = _areas(outlines[i], ground, masks[i], fraction, click_m)
        of_mesh_m2 = float(mesh_m2[masks[i]].sum()) / fraction
        volume = _volume(ground, masks[i], windows[i])
        measured = ColonySize(
            *areas, of_mesh_m2, float(height_m), volume.value, areas[2] / areas[0]
        )
        views = float(errors.views[known].mean())
        at = windows[i]
        top_std = np.hypot(height_std, _top_std_m(terrain.height_m[at], masks[i][at], 1 - fraction))
        stds = (*area_stds, relative * of_mesh_m2, top_std, volume.std)
        powers = (2, 2, 2, 2, 1, 3)
        shared = (
            power * calibration * each
            for power, each in zip(powers, astuple(measured)[:-1], strict=True)
        )
        totals = [float(np.hypot(*each)) for each in zip(stds, shared, strict=True)]
        own = ColonySize(*[*totals, area_stds[2] / areas[0]])
        counted = float((1 / holders[masks[i]]).mean())
        colonies[i] = Colony(
            outlines[i].name, outlines[i].label, measured, own, 1 - fraction, views, counted
        )
    return colonies


def _peaks(
    by_terrain: Callable[[Array], Array], terrain: Terrain, errors: TerrainErrors
) -> tuple[Array, Array]:
    """Highest places of a terrain without what noise adds and smoothing takes, and the standard
    errors of that.
    """
    alike_cells = errors.correlation_m / terrain.grid.cell_m
    values, of_corrections = peaks(by_terrain, terrain.height_m, errors.noise_m, alike_cells)
    by_draws = spread_of(by_terrain, terrain.height_m, errors.std_m, alike_cells)
    return values, np.hypot(by_draws, of_corrections)


def _areas(
    outline: Outline, ground: Ground, inside: Mask, known: float, click_m: float
) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Planar, tilted and surface area of an outline, square meters, and their standard errors; and
    that of the steepness, relative.

    A ring within a ring is taken off. The tilted area is NaN where a corner is not known.
    """
    planar_m2 = tilted_m2 = planar_variance = tilted_variance = 0.0
    for sign, ring in _signed(outline):
        corners = _open(ring)
        picks = [ground.pick(float(x), float(y), None, click_m) for x, y in corners]
        spots = [spot for spot in picks if spot is not None]
        planar_m2 += sign * polygon_area(ring)
        planar_variance += (click_m / 2) ** 2 * float(
            ((np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)) ** 2).sum()
        )
        unknown = len(spots) < len(corners)
        tilted = Measured(float("nan"), float("nan"), 2) if unknown else planar_area(spots)
        tilted_m2 += sign * tilted.value
        tilted_variance += tilted.std**2
    rows, columns = np.nonzero(inside)
    steepness, stds_m = ground.steepness(np.stack([columns, rows], axis=-1))
    surface_m2 = planar_m2 * float(steepness.mean()) if steepness.size else float("nan")
    relative = ground.steepness_std(steepness, stds_m, known) if steepness.size else float("nan")
    planar_std, tilted_std = float(np.sqrt(planar_variance)), float(np.sqrt(tilted_variance))
    by_outline = tilted_std / tilted_m2 if tilted_m2 > 0 else planar_std / planar_m2
    surface_std = surface_m2 * float(np.hypot(relative, by_outline))
    stds = planar_std, tilted_std, surface_std
    return (planar_m2, tilted_m2, surface_m2), stds, relative


def _signed(outline: Outline) -> list[tuple[int, Array]]:
    """The rings of an outline, with -1 for a ring within a ring, else 1."""
    first = np.array([ring[0] for ring in outline.rings])
    within = np.array([inside(first, ring) for ring in outline.rings])
    np.fill_diagonal(within, False)
    others = within.sum(axis=0)
    return [(-1 if n % 2 else 1, ring) for n, ring in zip(others, outline.rings, strict=True)]


def _cells_of(outline: Outline, mask: Mask, grid: Grid) -> float:
    """The number of cells inside an outline, of those beyond the map too."""
    corners = np.concatenate([grid.pixels(ring) for ring in outline.rings])
    if ((corners >= -0.5) & (corners <= np.array(grid.shape[::-1]) - 0.5)).all():
        return float(mask.sum())
    planar_m2 = sum(sign * polygon_area(ring) for sign, ring in _signed(outline))
    return max(planar_m2 / grid.cell_m**2, float(mask.sum()))


def _open(ring: Array) -> Array:
    """A ring without its last corner where that is the first again."""
    return ring[:-1] if len(ring) > 1 and (ring[0] == ring[-1]).all() else ring


def height_above(heights: Array, inside: Mask) -> float:
    """The highest place above the plane through the rim."""
    above = (heights - rim_plane(heights, rim_of(heights, inside)))[inside]
    return float(np.nanmax(above)) if np.isfinite(above).any() else float("nan")


def _volume(ground: Ground, mask: Mask, window: tuple[slice, slice]) -> Measured:
    """Of the cells of an outline, as the page states it; NaN where it has none."""
    margin = RIM_CELLS + 1
    corner = window[1].start - margin, window[0].start - margin
    found = volume_of(ground, np.pad(mask[window], margin), corner)
    return found or Measured(float("nan"), float("nan"), 3)


def _top_std_m(heights: Array, inside: Mask, unseen: float) -> float:
    """Standard error of the highest place by what is smoothed away around it (``height_stds``), and
    by what was not seen: it departs from the rest, as does the plane through the rim, by the spread
    of the heights, at the part (``unseen``) of the outline and that of its rim.
    """
    rim = rim_of(heights, inside)
    above = np.where(inside, heights - rim_plane(heights, rim), np.nan)
    if not np.isfinite(above).any():
        return float("nan")
    smoothed_m = OF_EXTREMES * float(
        height_stds(heights)[np.unravel_index(np.nanargmax(above), above.shape)]
    )
    padded = np.pad(inside, RIM_CELLS)  # with what lies beyond the map
    unseen_rim = 1 - float(rim.sum()) / float(rim_of(np.zeros(padded.shape), padded).sum())
    return float(np.hypot(smoothed_m, np.nanstd(above) * np.sqrt(unseen + unseen_rim)))


def _window(mask: Mask) -> tuple[slice, slice]:
    """The cells around an outline, its rim with them."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    margin = RIM_CELLS + 1
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
    )
