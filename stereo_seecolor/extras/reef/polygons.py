"""Polygons (N, 2): their area, what lies inside them, sides that cross."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array, Mask


def polygon_area(outline: Array) -> float:
    """The area of a polygon (shoelace formula)."""
    x, y = outline.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def inside(places: Array, outline: Array) -> Mask:
    """(M,) which of places (M, 2) lie inside a polygon, by the number of sides to their right."""
    order = np.argsort(places[:, 1])
    place, x = _crossings([outline], places[order, 1])
    to_the_right = order[place[places[order[place], 0] < x]]
    return np.asarray(np.bincount(to_the_right, minlength=len(places)) % 2 == 1)


def cells_inside(rings: Sequence[Array], left: int, top: int, shape: tuple[int, int]) -> Mask:
    """(H, W) which cells have their centers inside; a ring within a ring is a hole.

    rings: columns and rows of corners. left, top: column and row of the first cell.
    """
    height, width = shape
    row, x = _crossings(rings, np.arange(top, top + height, dtype=np.float64))
    beside = np.clip(np.ceil(x) - left, 0, width).astype(np.int64)  # cells to the left
    odd = np.zeros((height, width + 1), np.bool_)
    np.logical_xor.at(odd, (row, beside), True)
    return np.asarray(np.logical_xor.accumulate(odd[:, :0:-1], axis=1)[:, ::-1])


def _crossings(rings: Sequence[Array], y: Array) -> tuple[NDArray[np.int64], Array]:
    """Where horizontal lines cross the sides of polygons: the number of the line, and x. y: of the
    lines, ascending.
    """
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    first, last = (
        np.searchsorted(y, of(start[:, 1], end[:, 1])) for of in (np.minimum, np.maximum)
    )
    count = last - first
    side = np.repeat(np.arange(len(start)), count)
    line = np.arange(len(side)) - np.repeat(np.cumsum(count) - count - first, count)
    (ax, ay), (bx, by) = start[side].T, end[side].T
    return line, (bx - ax) * (y[line] - ay) / (by - ay) + ax


def crosses_itself(outline: Array) -> bool:
    """Tell whether two sides of a polygon that share no corner cross."""
    ends = np.roll(outline, -1, axis=0)
    for i, (a, b) in enumerate(zip(outline, ends, strict=True)):
        c, d = (corners[i + 2 : len(outline) - (i == 0)] for corners in (outline, ends))
        if _crosses(a, b, c, d):
            return True
    return False


def cross(one: Array, other: Array) -> bool:
    """Tell whether a side of a polygon crosses a side of another."""
    ends = np.roll(other, -1, axis=0)
    return any(
        _crosses(a, b, other, ends) for a, b in zip(one, np.roll(one, -1, axis=0), strict=True)
    )


def _crosses(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Whether the line from a to b, (2,) each, crosses one from c to d, (N, 2) each."""
    crosses = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
    return bool(crosses.any())


def _side(a: Array, b: Array, point: Array) -> Array:
    (dx, dy), (x, y) = (b - a).T, (point - a).T
    return np.asarray(dx * y - dy * x)
