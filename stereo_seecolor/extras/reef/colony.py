"""Measures of a colony, or of anything that an outline encloses: planar area, surface area, height
and volume above the ground around it.
"""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.lengths_and_areas import inside as within
from stereo_seecolor.extras.reef.lengths_and_areas import planar_area, polygon_area
from stereo_seecolor.extras.reef.map_ground import Ground
from stereo_seecolor.extras.reef.outlines import Outline
from stereo_seecolor.extras.reef.site_surface import SiteMesh
from stereo_seecolor.mapping.raster.height_model import Terrain, TerrainErrors
from stereo_seecolor.mapping.raster.noise import (
    CORRECTION_SETTINGS,
    OF_EXTREMES,
    noise_bias,
    shape_stds,
    spread_of,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RIM_CELLS = 2
"""The ground around an outline: the cells up to this far outside."""
FEWEST_RIM_CELLS = 6
SIDES_SEEN = 0.5
"""Part of its sides in the mesh from which a colony is taken to reach down to the ground."""
BENEATH = 0.75
"""Mean departure of the ground beneath an outline from the plane through its rim, over the root
mean product of what neighboring cells of the rim depart: of Brownian surfaces of dimensions 2.1 to
2.5 (0.66 to 0.87).
"""


@dataclass(frozen=True)
class ColonySize:
    """Square meters, meters and liters.

    planar_m2: in plan. tilted_m2: of the flat polygon through the outline's corners on the ground.
    surface_m2: of planes through 3x3 cells, as the page and ``measure`` state it. mesh_m2: of the
    mesh, noise and overhangs included. height_m, volume_l: above the plane through the rim,
    without what noise adds; where sides were not seen, what is under an overhang counts, and may
    be empty: the standard error holds it, and a volume that is not positive is NaN. rugosity:
    surface over planar area.
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
) -> list[Colony | None]:
    """Measure each outline; None where nothing of it was seen.

    height_std_m: of a height, click_m: of a corner, calibration: of a length, relative; as the page
    has them.
    """
    masks = [outline.mask(terrain.grid) for outline in outlines]
    seen = [i for i, mask in enumerate(masks) if (mask & terrain.known).any()]
    if not seen:
        return [None] * len(outlines)
    windows = {i: _window(masks[i]) for i in seen}
    holders = np.asarray(sum(mask.astype(np.int32) for mask in masks))

    def by_terrain(heights: Array) -> Array:
        parts = [(heights[windows[i]], masks[i][windows[i]]) for i in seen]
        return np.array(
            [
                above_rim(own, inside, rim_of(own, inside), terrain.grid.cell_m)
                for own, inside in parts
            ]
        ).ravel()

    grid = terrain.grid
    ground = Ground(
        terrain.height_m.astype(np.float32), grid.west_m, grid.north_m, grid.cell_m, height_std_m
    )
    values, errs = (
        each.reshape(len(seen), -1) for each in _without_noise(by_terrain, terrain, errors)
    )
    colonies: list[Colony | None] = [None] * len(outlines)
    for i, value, error in zip(seen, values, errs, strict=True):
        known = masks[i] & terrain.known
        fraction = float(known.sum() / masks[i].sum())
        areas, area_stds, relative = _areas(outlines[i], ground, masks[i], fraction, click_m)
        mesh_m2 = mesh_area_m2(mesh, terrain, masks[i]) / fraction
        under = overhang_l(mesh, terrain, masks[i], ground.gap_m)
        refused = under > 0 and not value[1] > 0
        measured = ColonySize(
            *areas,
            mesh_m2,
            float(value[0]),
            float("nan") if refused else float(value[1]),
            areas[2] / areas[0],
        )
        views = float(errors.views[known].mean())
        at = windows[i]
        beneath_l = ground_std_l(terrain.height_m[at], masks[i][at], terrain.grid.cell_m)
        unseen_l = _unseen_volume_l(terrain, masks[i], at)
        height_m = np.hypot(error[0], _top_std_m(terrain.height_m[at], masks[i][at]))
        seen_std_l = float(np.linalg.norm([error[1], beneath_l, unseen_l]))
        volume_l = (
            float("nan") if refused else np.hypot(seen_std_l, min(under, value[1]) / np.sqrt(3))
        )
        stds = (*area_stds, relative * mesh_m2, height_m, volume_l)
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


def _without_noise(
    by_terrain: Callable[[Array], Array], terrain: Terrain, errors: TerrainErrors
) -> tuple[Array, Array]:
    """What a terrain measures without what noise adds to it, and the standard errors of that."""
    alike_cells = errors.correlation_m / terrain.grid.cell_m
    added = noise_bias(by_terrain, terrain.height_m, errors.noise_m, alike_cells)
    by_draws = spread_of(by_terrain, terrain.height_m, errors.std_m, alike_cells)
    return by_terrain(terrain.height_m) - added, np.hypot(
        by_draws, CORRECTION_SETTINGS.of_noise * added
    )


def _areas(
    outline: Outline, ground: Ground, inside: Mask, known: float, click_m: float
) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
    """Planar, tilted and surface area of an outline, square meters, and their standard errors; and
    that of the steepness, relative.

    A ring within a ring is taken off. Corners that are not known have no part in the tilted area.
    """
    planar_m2 = tilted_m2 = planar_variance = tilted_variance = 0.0
    for number, ring in enumerate(outline.rings):
        others = [other for k, other in enumerate(outline.rings) if k != number]
        sign = -1 if sum(within(other, *ring[0]) for other in others) % 2 else 1
        spots = [
            spot
            for spot in (ground.pick(float(x), float(y), None, click_m) for x, y in _open(ring))
            if spot is not None
        ]
        planar_m2 += sign * polygon_area(ring)
        corners = _open(ring)
        planar_variance += (click_m / 2) ** 2 * float(
            ((np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)) ** 2).sum()
        )
        if len(spots) > 2:
            tilted = planar_area(spots)
            tilted_m2 += sign * tilted.value
            tilted_variance += tilted.std**2
    rows, columns = np.nonzero(inside)
    steepness, stds_m = ground.steepness(np.stack([columns, rows], axis=-1))
    surface_m2 = planar_m2 * float(steepness.mean()) if steepness.size else float("nan")
    relative = ground.steepness_std(steepness, stds_m, known) if steepness.size else float("nan")
    tilted_std = float(np.sqrt(tilted_variance))
    by_outline = tilted_std / tilted_m2 if tilted_m2 > 0 else 0.0
    surface_std = surface_m2 * float(np.hypot(relative, by_outline))
    stds = float(np.sqrt(planar_variance)), tilted_std, surface_std
    return (planar_m2, tilted_m2, surface_m2), stds, relative


def _open(ring: Array) -> Array:
    """A ring without its last corner where that is the first again."""
    return ring[:-1] if len(ring) > 1 and (ring[0] == ring[-1]).all() else ring


def _unseen_volume_l(terrain: Terrain, inside: Mask, window: tuple[slice, slice]) -> float:
    """Standard error of a volume from the part that was not seen and is taken to be like the rest.

    Its mean may differ from that of the rest by the standard deviation of what was seen.
    """
    heights, own = terrain.height_m[window], inside[window]
    above = (heights - rim_plane(heights, rim_of(heights, own)))[own]
    if np.isfinite(above).all() or not np.isfinite(above).any():
        return 0.0
    return (
        1000
        * float(np.std(above[np.isfinite(above)]))
        * float((inside & ~terrain.known).sum())
        * terrain.grid.cell_m**2
    )


def overhang_l(mesh: SiteMesh, terrain: Terrain, mask: Mask, gap_m: float) -> float:
    """Liters below the top of an outline that may be empty, since its sides were not seen; 0 where
    they were, or where it has none.

    Sides are steps to the cells around. Seen ones are in the mesh, over the cells beside them.
    """
    heights = terrain.height_m
    expected_m2, high = 0.0, np.zeros(mask.shape, bool)
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        beside = np.roll(heights, shift, axis)
        step_m = np.where(mask & ~np.roll(mask, shift, axis), heights - beside, 0)
        side = np.nan_to_num(step_m) > gap_m
        high |= side
        expected_m2 += float(step_m[side].sum()) * terrain.grid.cell_m
    if not high.any():
        return 0.0
    near = cv2.dilate(high.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    level_m2 = float((near & terrain.known).sum()) * terrain.grid.cell_m**2
    seen_m2 = mesh_area_m2(mesh, terrain, near) - level_m2
    if seen_m2 > SIDES_SEEN * expected_m2:
        return 0.0
    window = _window(mask)
    rim = rim_of(heights[window], mask[window])
    ground_m = float(np.median(heights[window][rim])) if rim.any() else float("nan")
    above = heights[mask] - ground_m
    return 1000 * float(np.maximum(np.nan_to_num(above), 0).sum()) * terrain.grid.cell_m**2


def mesh_area_m2(mesh: SiteMesh, terrain: Terrain, mask: Mask) -> float:
    """Square meters of mesh over, and below, the cells of a mask."""
    return float(mesh.area_over(terrain.grid)[mask].sum())


def above_rim(heights: Array, inside: Mask, rim: Mask, cell_m: float) -> tuple[float, float]:
    """Height, and volume in liters, above the plane through the rim."""
    above = (heights - rim_plane(heights, rim))[inside]
    seen = above[np.isfinite(above)]
    if not len(seen):
        return float("nan"), float("nan")
    return float(seen.max()), 1000 * float(seen.mean()) * float(inside.sum()) * cell_m**2


def ground_std_l(heights: Array, inside: Mask, cell_m: float) -> float:
    """Standard error of a volume by the ground beneath, which is not seen: on average it departs
    from the plane as the ground around does, as far as that is alike from cell to cell.
    """
    rim = rim_of(heights, inside)
    off = np.where(rim, heights - rim_plane(heights, rim), np.nan)
    pairs = np.concatenate([(off[1:] * off[:-1]).ravel(), (off[:, 1:] * off[:, :-1]).ravel()])
    alike = float(pairs[np.isfinite(pairs)].mean()) if np.isfinite(pairs).any() else float("nan")
    return 1000 * BENEATH * float(np.sqrt(max(alike, 0.0)) * inside.sum()) * cell_m**2


def _top_std_m(heights: Array, inside: Mask) -> float:
    """Standard error of the highest place by what is smoothed away around it (``height_stds``)."""
    above = np.where(inside, heights - rim_plane(heights, rim_of(heights, inside)), np.nan)
    if not np.isfinite(above).any():
        return float("nan")
    return OF_EXTREMES * float(
        shape_stds(heights)[np.unravel_index(np.nanargmax(above), above.shape)]
    )


def _window(mask: Mask) -> tuple[slice, slice]:
    """The cells around an outline, its rim with them."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    margin = RIM_CELLS + 1
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
    )


def rim_of(heights: Array, inside: Mask) -> Mask:
    """The ground around an outline, where it was seen."""
    near = cv2.dilate(inside.astype(np.uint8), np.ones((2 * RIM_CELLS + 1,) * 2, np.uint8)) > 0
    return np.asarray(near & ~inside & np.isfinite(heights))


def rim_plane(heights: Array, rim: Mask) -> Array:
    """(H, W) the plane through the ground of a rim; NaN where too little of that was seen."""
    rows, columns = np.nonzero(rim)
    if len(rows) < FEWEST_RIM_CELLS:
        return np.full_like(heights, np.nan)
    basis = np.stack([columns, rows, np.ones(len(rows))], axis=-1).astype(np.float64)
    plane = np.linalg.lstsq(basis, heights[rim], rcond=None)[0]
    row, column = np.indices(heights.shape)
    return np.asarray(column * plane[0] + row * plane[1] + plane[2])
