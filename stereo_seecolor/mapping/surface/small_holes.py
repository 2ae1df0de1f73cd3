"""Holes of a mesh that a single unseen voxel leaves are closed where it is shown.

Marching cubes leaves out the eight cubes around a voxel that was not seen. Where those around them
are known, the surface has a hole of one to some triangles, through which light shines, and which a
coarser level of detail shows as a larger one. Larger gaps stay open: nobody saw what is there.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROUNDING = 1e-3
"""Of a cell: positions are float32 in map coordinates."""
CELLS = 2
"""Along each axis: the cubes around a voxel."""
MOST_EDGES = 24
"""Of such a hole: three for each of the eight cubes."""


def closed(
    points_m: NDArray[np.floating], triangles: NDArray[np.integer], cell_m: float
) -> NDArray[np.int64]:
    """Add triangles in the holes of a mesh that have three edges, or lie within two cells along each axis.

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
    once = np.bincount(start, minlength=len(points)) == 1
    once &= np.bincount(end, minlength=len(points)) == 1
    graph = coo_array((np.ones(len(start), np.int8), (start, end)), (len(points),) * 2)
    count, loop = connected_components(graph, directed=False)
    size = np.bincount(loop, minlength=count)
    simple = np.bincount(loop, once, minlength=count) == size
    span_m = np.full((count, 3), -np.inf), np.full((count, 3), np.inf)
    np.maximum.at(span_m[0], loop, points_m[points])
    np.minimum.at(span_m[1], loop, points_m[points])
    fits = (span_m[0] - span_m[1] <= CELLS * cell_m * (1 + ROUNDING)).all(axis=1)
    small = simple & ((size == 3) | (fits & (size <= MOST_EDGES)))
    following = np.zeros(len(points), np.int64)
    following[start] = end
    first = np.unique(loop, return_index=True)[1][small]
    corner, added = following[first], [mesh]
    while len(first):  # a fan from the first point of each hole, facing as the surface around it
        after = following[corner]
        open_still = after != first
        first, corner, after = first[open_still], corner[open_still], after[open_still]
        added.append(points[np.stack([first, after, corner], axis=1)])
        corner = after
    return np.concatenate(added)


def boundary(triangles: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the edges of an odd number of triangles (T, 3): where each starts and ends, (E,)."""
    start = np.asarray(triangles, np.int64).ravel()
    end = np.roll(np.asarray(triangles, np.int64), -1, axis=1).ravel()
    key = np.minimum(start, end) << 32 | np.maximum(start, end)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    odd = first[count % 2 == 1]
    return start[odd], end[odd]
