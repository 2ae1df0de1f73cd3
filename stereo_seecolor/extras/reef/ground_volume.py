"""Volume of what an outline on a terrain encloses, above the plane through the ground around it,
for ``measure``, ``metrics`` and the page: web/src/volume.ts computes the same.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from stereo_seecolor.extras.reef.lengths_and_areas import Measured
from stereo_seecolor.extras.reef.map_ground import Ground, Spot
from stereo_seecolor.extras.reef.polygons import cells_inside
from stereo_seecolor.mapping.raster.sides import FALLS
from stereo_seecolor.records import Array, Mask

RIM_CELLS = 2
"""The ground around an outline: the cells up to this far outside."""
FEWEST_RIM_CELLS = 6
BENEATH = 0.75
"""Mean departure of the ground beneath an outline from the plane through its rim, over the root
mean product of what neighboring cells of the rim depart: of Brownian surfaces of dimensions 2.1 to
2.5 (0.66 to 0.87).
"""
ALIKE_REACH = 3.0
"""Correlation lengths beyond which errors of heights are independent: exp(-4.5) is 1 %."""


def volume_above(ground: Ground, spots: Sequence[Spot]) -> Measured | None:
    """The volume in liters, of power 3; None where too little of the ground around was seen, or
    where it is not positive, as of something hollow below.
    """
    outline = ground.grid.pixels(np.array([spot.point_m for spot in spots]))
    corner = np.floor(outline.min(axis=0)).astype(int) - RIM_CELLS - 1
    width, height = np.ceil(outline.max(axis=0)).astype(int) + RIM_CELLS + 2 - corner
    left, top = corner.tolist()
    own = cells_inside([outline], left, top, (height, width))
    return volume_of(ground, own, (left, top))


def volume_of(ground: Ground, own: Mask, corner: tuple[int, int]) -> Measured | None:
    """The volume over cells (H, W), as ``volume_above`` states it. own: with at least RIM_CELLS + 1
    others around. corner: column and row of the first.

    Its standard error holds errors of heights, the ground beneath, which is not seen, what was not
    seen of it, and what may be hollow where its sides are steps that were not seen either.
    """
    (left, top), (height, width) = corner, own.shape
    window = left, top, left + width - 1, top + height - 1
    heights = ground.window(*window)
    rim, known = rim_of(heights, own), own & np.isfinite(heights)
    if rim.sum() < FEWEST_RIM_CELLS or not known.any():
        return None
    volume_l = volume_above_rim(heights, own, rim, ground.grid.cell_m)
    if not volume_l > 0:
        return None
    above = (heights - rim_plane(heights, rim))[known]
    open_sides = _open_sides(heights, own, ground.sides_in(*window), ground.gap_m)
    stds = (
        ground.std_m * _gain_l(own, known, rim, ground.grid.cell_m, ground.correlation_m),
        ground_std_l(heights, own, ground.grid.cell_m),
        1000 * float(above.std()) * float((own & ~known).sum()) * ground.grid.cell_m**2,
        volume_l * open_sides / np.sqrt(3),  # even from empty to full
    )
    return Measured(volume_l, float(np.linalg.norm(stds)), 3)


def _gain_l(own: Mask, known: Mask, rim: Mask, cell_m: float, correlation_m: float) -> float:
    """Standard error of the volume, liters, for a height's of 1 m: the volume is linear in the
    heights inside and around, whose errors are alike as a Gaussian of their distance.
    """
    row, column = np.indices(own.shape)
    basis = np.stack([np.ones(own.shape), column, row], axis=-1)
    of_rim = basis[rim]
    each_l = 1000 * cell_m**2 * float(own.sum()) / float(known.sum())
    weight = np.where(known, each_l, 0.0)
    weight[rim] = -each_l * (of_rim @ np.linalg.solve(of_rim.T @ of_rim, basis[known].sum(axis=0)))
    reach = int(np.ceil(ALIKE_REACH * correlation_m / cell_m))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    alike = np.exp(-(x**2 + y**2) * cell_m**2 / (2 * max(correlation_m, 1e-9) ** 2))
    beside = cv2.filter2D(weight, -1, alike, borderType=cv2.BORDER_CONSTANT)
    variance = float((weight * beside).sum())
    return float(np.sqrt(max(variance, 0.0)))


def _open_sides(heights: Array, own: Mask, seen: Mask, gap_m: float) -> float:
    """The part of what is enclosed that may be empty below: edges of cells at which the ground
    falls off by a step whose side was not seen, or at which the outline ends and the ground is not
    known, over all edges at which the outline ends; at most 1.

    Steps inside count too: an outline is drawn a little outside of what it encloses.
    """
    ends = open_sides = 0
    for axis, shift in FALLS:
        end = own & ~np.roll(own, shift, axis)
        fall = heights - np.roll(heights, shift, axis)
        ends += int(end.sum())
        open_sides += int(((end & np.isnan(fall)) | (own & (fall > gap_m) & ~seen)).sum())
    return min(open_sides / max(ends, 1), 1.0)


def volume_above_rim(heights: Array, inside: Mask, rim: Mask, cell_m: float) -> float:
    """Volume, liters, of known cells above the plane through the rim, as if all were known."""
    above = (heights - rim_plane(heights, rim))[inside & np.isfinite(heights)]
    return 1000 * float(above.mean()) * float(inside.sum()) * cell_m**2


def ground_std_l(heights: Array, inside: Mask, cell_m: float) -> float:
    """Standard error of a volume by the ground beneath, which is not seen: on average it departs
    from the plane as the ground around does, as far as that is alike from cell to cell.
    """
    rim = rim_of(heights, inside)
    off = np.where(rim, heights - rim_plane(heights, rim), np.nan)
    pairs = np.concatenate([(off[1:] * off[:-1]).ravel(), (off[:, 1:] * off[:, :-1]).ravel()])
    alike = float(pairs[np.isfinite(pairs)].mean()) if np.isfinite(pairs).any() else float("nan")
    return 1000 * BENEATH * float(np.sqrt(max(alike, 0.0)) * inside.sum()) * cell_m**2


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
