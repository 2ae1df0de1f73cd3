"""Holes of a mesh that a single unseen voxel leaves are closed where it is shown.

Marching cubes leaves out the eight cubes around a voxel that was not seen. Where those around them
are known, the surface has a hole of one to some triangles, through which light shines, and which a
coarser level of detail shows as a larger one. Larger gaps stay open: nobody saw what is there.
"""

import numpy as np
from numpy.typing import NDArray

ROUNDING = 1e-3
"""Of a cell: positions are float32 in map coordinates."""
CELLS = 2
"""Along each axis: the cubes around a voxel."""
MOST_EDGES = 24
"""Of such a hole: three for each of the eight cubes."""


def closed(
    points_m: NDArray[np.floating], triangles: NDArray[np.integer], cell_m: float
) -> NDArray[np.int64]:
    """Add triangles in the holes of a mesh that have three edges, or span two cells at most.

    points_m: (V, 3). triangles: (T, 3), all facing the same side. cell_m: edge of the cells that
    the mesh was made from. No point is added; returns (T + added, 3) int64. A hole that touches
    another one at a point stays open.
    """
    mesh: NDArray[np.int64] = np.asarray(triangles, np.int64)
    starts, ends = boundary(mesh)
    if not len(starts):
        return mesh
    points, edges = np.unique(np.stack([starts, ends]), return_inverse=True)
    start, end = edges.reshape(2, -1)
    following = np.full(len(points), -1)
    following[start] = end
    for ends_or_starts in (start, end):  # where holes touch, none can be told from the other
        following[np.bincount(ends_or_starts, minlength=len(points)) != 1] = -1
    first = _first_points(following, points_m[points], CELLS * cell_m * (1 + ROUNDING))
    corner, added = following[first], [mesh]
    while len(first):  # a fan from the first point of each hole, facing as the surface around it
        after = following[corner]
        is_open = after != first
        first, corner, after = first[is_open], corner[is_open], after[is_open]
        added.append(points[np.stack([first, after, corner], axis=1)])
        corner = after
    return np.concatenate(added)


def _first_points(
    following: NDArray[np.int64], places_m: NDArray[np.floating], most_m: float
) -> NDArray[np.int64]:
    """The lowest number of the points of each hole that is to be closed.

    following: (P,) the next point around the hole, -1 where several holes touch. places_m: (P, 3).
    """
    first = np.flatnonzero(following >= 0)
    at, low_m, high_m = following[first], places_m[first], places_m[first]
    found = [first[:0]]
    for edges in range(1, MOST_EDGES + 1):
        fits = (high_m - low_m <= most_m).all(axis=1) | (edges <= 3)
        found.append(first[fits & (at == first)])
        on = fits & (at > first) & (following[at] >= 0)  # else another point of it is the lowest
        first, at = first[on], at[on]
        low_m = np.minimum(low_m[on], places_m[at])
        high_m = np.maximum(high_m[on], places_m[at])
        at = following[at]
    return np.concatenate(found)


def boundary(triangles: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the edges of an odd number of triangles (T, 3): where each starts and ends, (E,)."""
    start = np.asarray(triangles, np.int64).ravel()
    end = np.roll(np.asarray(triangles, np.int64), -1, axis=1).ravel()
    key = np.minimum(start, end) << 32 | np.maximum(start, end)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    odd = first[count % 2 == 1]
    return start[odd], end[odd]
