"""Volume of what an outline on a terrain encloses, above the plane through the ground around it;
web/src/volume.ts computes the same.

``metrics`` measures the same volume with each cell's own standard error, and knows from the mesh
whether the sides were seen (colony.py). Here the terrain alone is known.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.colony import (
    FEWEST_RIM_CELLS,
    RIM_CELLS,
    above_rim,
    ground_std_l,
    rim_of,
    rim_plane,
)
from stereo_seecolor.extras.reef.lengths_and_areas import Measured, inside
from stereo_seecolor.extras.reef.map_ground import Ground, Spot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ALIKE_REACH = 3.0
"""Correlation lengths beyond which errors of heights are independent: exp(-4.5) is 1 %."""


def volume_above(ground: Ground, spots: Sequence[Spot], correlation_m: float) -> Measured | None:
    """The volume in liters, of power 3; None where too little of the ground around was seen, or
    where it is not positive, as of something hollow below.

    correlation_m: distance over which errors of heights are alike.
    Its standard error holds errors of heights, the ground beneath, which is not seen, what was not
    seen of it, and what may be hollow where its sides are steps.
    """
    outline = np.array([ground.cell(*spot.point_m[:2]) for spot in spots])
    corner = np.floor(outline.min(axis=0)).astype(int) - RIM_CELLS - 1
    width, height = np.ceil(outline.max(axis=0)).astype(int) + RIM_CELLS + 2 - corner
    left, top = corner.tolist()
    heights = ground.window(left, top, left + width - 1, top + height - 1)
    own = np.array(
        [
            [inside(outline, corner[0] + column, corner[1] + row) for column in range(width)]
            for row in range(height)
        ]
    )
    rim, known = rim_of(heights, own), own & np.isfinite(heights)
    if rim.sum() < FEWEST_RIM_CELLS or not known.any():
        return None
    volume_l = above_rim(heights, own, rim, ground.cell_m)[1]
    if not volume_l > 0:
        return None
    above = (heights - rim_plane(heights, rim))[known]
    stds = (
        ground.std_m * _gain_l(own, known, rim, ground.cell_m, correlation_m),
        ground_std_l(heights, own, ground.cell_m),
        1000 * float(above.std()) * float((own & ~known).sum()) * ground.cell_m**2,
        volume_l * _stepped(heights, own, ground.gap_m) / np.sqrt(3),  # even from empty to full
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
    around, (height, width) = np.pad(weight, reach), weight.shape
    variance = 0.0
    for y in range(-reach, reach + 1):
        for x in range(-reach, reach + 1):
            alike = np.exp(-((x**2 + y**2) * cell_m**2) / (2 * correlation_m**2)) if x or y else 1.0
            beside = around[reach + y : reach + y + height, reach + x : reach + x + width]
            variance += float(alike) * float((weight * beside).sum())
    return float(np.sqrt(max(variance, 0.0)))


def _stepped(heights: Array, own: Mask, gap_m: float) -> float:
    """The part of an outline's sides, in edges of cells, at which the ground falls off by a step,
    or is not known.
    """
    sides = steps = 0
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        side = own & ~np.roll(own, shift, axis)
        fall = np.nan_to_num(heights - np.roll(heights, shift, axis), nan=np.inf)
        sides += int(side.sum())
        steps += int((side & (fall > gap_m)).sum())
    return steps / max(sides, 1)
