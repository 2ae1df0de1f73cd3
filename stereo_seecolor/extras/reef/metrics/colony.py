"""Measures of a colony, or of anything that an outline encloses: planar area, surface area, height and volume above the ground
around it.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.measuring.measures import unseen_std
from stereo_seecolor.extras.reef.metrics.outlines import Outline
from stereo_seecolor.extras.reef.metrics.redraw import spread_of
from stereo_seecolor.extras.reef.site.mesh import SiteMesh
from stereo_seecolor.extras.reef.site.terrain import Terrain
from stereo_seecolor.extras.reef.site.terrain_errors import TerrainErrors
from stereo_seecolor.mapping.raster.reef_metrics import surface_rugosity

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RIM_CELLS = 2
"""The ground around an outline: the cells up to this far outside."""
FEWEST_RIM_CELLS = 6
SECTORS = 8
"""Of the ground around an outline, left out in turn: how much the volume hangs on where the ground was taken."""


@dataclass(frozen=True)
class Measured:
    """Square meters, meters and liters. surface_m2: of the mesh, overhangs included. volume_l: above the plane through the rim."""

    planar_m2: float
    surface_m2: float
    height_m: float
    volume_l: float
    rugosity: float


@dataclass(frozen=True)
class Colony:
    """The measures of an outline, with standard errors from the range errors; unseen: fraction of its cells without a surface.

    views: mean number of frames behind a cell. counted: mean, over its cells, of 1 over the outlines that hold the cell, so that
    outlines that overlap count their common cells once together.
    """

    name: str
    label: str
    measured: Measured
    standard_error: Measured
    unseen: float
    views: float
    counted: float = 1.0


def measure_outlines(outlines: Sequence[Outline], mesh: SiteMesh, terrain: Terrain, errors: TerrainErrors) -> list[Colony | None]:
    """Measure each outline; None where nothing of it was seen."""
    masks = [outline.mask(terrain.grid) for outline in outlines]
    seen = [i for i, mask in enumerate(masks) if (mask & terrain.known).any()]
    if not seen:
        return [None] * len(outlines)
    windows = {i: _window(masks[i]) for i in seen}
    holders = np.asarray(sum(mask.astype(np.int32) for mask in masks))

    def by_terrain(heights: Array) -> Array:
        each = [_by_terrain(heights[windows[i]], masks[i][windows[i]], terrain.grid.cell_m) for i in seen]
        return np.array([astuple(one) for one in each]).ravel()

    values, errs = (v.reshape(len(seen), -1) for v in (by_terrain(terrain.height_m), spread_of(by_terrain, terrain, errors)))
    colonies: list[Colony | None] = [None] * len(outlines)
    for i, value, error in zip(seen, values, errs, strict=True):
        known = masks[i] & terrain.known
        fraction = float(known.sum() / masks[i].sum())
        surface_m2 = mesh_area_m2(mesh, terrain, masks[i]) / fraction
        measured = replace(Measured(*value), surface_m2=surface_m2, rugosity=surface_m2 / value[0])
        views = float(errors.views[known].mean())
        ground = _ground_error(terrain.height_m[windows[i]], masks[i][windows[i]], terrain.grid.cell_m)
        unseen = _unseen_error(terrain, mesh, masks[i], windows[i], measured)
        own = Measured(*np.linalg.norm([error, ground, unseen], axis=0))
        counted = float((1 / holders[masks[i]]).mean())
        colonies[i] = Colony(outlines[i].name, outlines[i].label, measured, own, 1 - fraction, views, counted)
    return colonies


def _unseen_error(terrain: Terrain, mesh: SiteMesh, inside: Mask, window: tuple[slice, slice], measured: Measured) -> Array:
    """(5,) standard errors as of a Measured, from the part that was not seen and is taken to be like the rest.

    Its mean may differ from that of the rest by the standard deviation of what was seen.
    """
    known = inside & terrain.known
    if known.sum() == inside.sum():
        return np.zeros(5)
    row, column, triangle_m2 = terrain.triangles_of(mesh)
    of_cell = np.zeros(inside.shape)
    np.add.at(of_cell, (row, column), triangle_m2)
    surface_m2 = unseen_std(of_cell[known], float(known.sum() / inside.sum())) * measured.surface_m2
    heights, own = terrain.height_m[window], inside[window]
    above = (heights - _plane(heights, _rim(heights, own)))[own]
    spread_m = float(np.std(above[np.isfinite(above)])) if np.isfinite(above).any() else np.nan
    volume_l = 1000 * spread_m * float((inside & ~terrain.known).sum()) * terrain.grid.cell_m**2
    return np.array([0, surface_m2, 0, volume_l, surface_m2 / measured.planar_m2])


def mesh_area_m2(mesh: SiteMesh, terrain: Terrain, mask: Mask) -> float:
    """Square meters of mesh over, and below, the cells of a mask."""
    row, column, area_m2 = terrain.triangles_of(mesh)
    return float(area_m2[mask[row, column]].sum())


def _by_terrain(heights: Array, inside: Mask, cell_m: float) -> Measured:
    """As the terrain alone shows it; what was not seen is taken to be like the rest."""
    height_m, volume_l = _above(heights, inside, _rim(heights, inside), cell_m)
    planar_m2 = float(inside.sum()) * cell_m**2
    own = np.where(inside, heights, np.nan)
    rugosity = surface_rugosity(own, cell_m) if _has_squares(own) else float("nan")
    return Measured(planar_m2, rugosity * planar_m2, height_m, volume_l, rugosity)


def _above(heights: Array, inside: Mask, rim: Mask, cell_m: float) -> tuple[float, float]:
    """Height, and volume in liters, above the plane through the rim."""
    above = (heights - _plane(heights, rim))[inside]
    seen = above[np.isfinite(above)]
    if not len(seen):
        return float("nan"), float("nan")
    return float(seen.max()), 1000 * float(seen.mean()) * float(inside.sum()) * cell_m**2


def _ground_error(heights: Array, inside: Mask, cell_m: float) -> Array:
    """(5,) standard errors as of a Measured, from uneven ground: jackknife over eighths of the rim (Efron and Stein 1981)."""
    rim = _rim(heights, inside)
    row, column = np.indices(heights.shape)
    middle = [float(np.flatnonzero(inside.any(axis=axis)).mean()) for axis in (1, 0)]
    sector = ((np.arctan2(row - middle[0], column - middle[1]) / (2 * np.pi) * SECTORS) % SECTORS).astype(int)
    found = np.array([_above(heights, inside, rim & (sector != left_out), cell_m) for left_out in range(SECTORS)])
    height_m, volume_l = np.sqrt((SECTORS - 1) * found.var(axis=0))
    return np.array([0, 0, height_m, volume_l, 0])


def _has_squares(heights: Array) -> bool:
    """Whether any four neighbors are known."""
    known = np.isfinite(heights)
    return bool((known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]).any())


def _window(mask: Mask) -> tuple[slice, slice]:
    """The cells around an outline, its rim with them."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    margin = RIM_CELLS + 1
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
    )


def _rim(heights: Array, inside: Mask) -> Mask:
    """The ground around an outline, where it was seen."""
    near = cv2.dilate(inside.astype(np.uint8), np.ones((2 * RIM_CELLS + 1,) * 2, np.uint8)) > 0
    return np.asarray(near & ~inside & np.isfinite(heights))


def _plane(heights: Array, rim: Mask) -> Array:
    """(H, W) the plane through the ground of a rim; NaN where too little of that was seen."""
    rows, columns = np.nonzero(rim)
    if len(rows) < FEWEST_RIM_CELLS:
        return np.full_like(heights, np.nan)
    basis = np.stack([columns, rows, np.ones(len(rows))], axis=-1).astype(np.float64)
    plane = np.linalg.lstsq(basis, heights[rim], rcond=None)[0]
    row, column = np.indices(heights.shape)
    return np.asarray(column * plane[0] + row * plane[1] + plane[2])
