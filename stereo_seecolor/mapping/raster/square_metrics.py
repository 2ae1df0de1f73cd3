"""The metrics of one square of terrain by its height ranges.

Rugosity, fractal dimension and height range of a square are geometrically related (Torres-Pulliza
et al. 2020, Nature Ecology & Evolution 4:1495): the mean height range dh(L) of squares of edge L
grows as L^(3 - D). Their plane: R^2 = dh(L0)^2 / (2 L0^2) + 1 with L0 the finest edge. Means of
ranges and the logarithmic regression are those of the R package habtools (method hvar). Nothing is
leveled: a slope counts as height, as it does there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Heights = NDArray[np.float64]


@dataclass(frozen=True)
class RdhSettings:
    """The scales that are used."""

    # edges of L, L/2, ... L/16, as habtools' documentation suggests: 2, 1, 0.5, 0.25, 0.125 m
    halvings: int = 4
    finest_cells: int = 4  # a height range of fewer cells is too small
    fewest_scales: int = 3  # two always lie on a line


SETTINGS = RdhSettings()
STUDENT = {2: 2.195, 3: 1.624}
"""By degrees of freedom: the 97.5 % quantile of Student's distribution over the normal one."""


def height_ranges(heights: Heights, cell_m: float) -> tuple[Heights, Heights]:
    """Edges of squares, from all the terrain's down, and the mean height range of each: (K,) m."""
    edge_m = min(heights.shape) * cell_m
    parts = [
        2**k
        for k in range(SETTINGS.halvings + 1)
        if edge_m / 2**k >= SETTINGS.finest_cells * cell_m
    ]
    return edge_m / np.array(parts, np.float64), np.array(
        [mean_height_range(heights, part) for part in parts]
    )


def rugosity_hvar(edges_m: Heights, ranges_m: Heights) -> float:
    """R from the height range at the finest edge."""
    finest = ranges_m[-1] / edges_m[-1] if len(edges_m) else np.nan
    return float(np.sqrt(finest**2 / 2 + 1))


def mean_height_range(heights: Heights, parts: int) -> float:
    """Mean of highest less lowest over parts x parts squares of which half is known."""
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
    if usable.sum() >= SETTINGS.fewest_scales:
        return 3 - float(np.polyfit(np.log(edges_m[usable]), np.log(ranges_m[usable]), 1)[0])
    return 2.0 if len(ranges_m) and (ranges_m == 0).all() else float("nan")


def dimension_std(edges_m: Heights, ranges_m: Heights) -> float:
    """Standard error of the dimension by how far the ranges lie off a power law, such that two of
    them hold 95 %; NaN of fewer than four, of which the error itself is not known.
    """
    usable = np.isfinite(ranges_m) & (ranges_m > 0)
    if usable.sum() - 2 not in STUDENT:
        return float("nan")
    x, y = np.log(edges_m[usable]), np.log(ranges_m[usable])
    off = y - np.polyval(np.polyfit(x, y, 1), x)
    std = np.sqrt((off**2).sum() / (len(x) - 2) / ((x - x.mean()) ** 2).sum())
    return float(STUDENT[len(x) - 2] * std)
