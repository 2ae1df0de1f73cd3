"""Connected parts of a mesh, and how large they are."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components


def connected_parts(triangles: NDArray[np.int32], points: int) -> NDArray[np.int64]:
    """Number the connected parts of a mesh from 0, as they come: (V,) int64, the part of each of so
    many points.

    triangles: (T, 3) int32.
    """
    one, other = triangles[:, :2].ravel(), triangles[:, 1:].ravel()
    edges = csr_array((np.ones(len(one), np.int8), (one, other)), shape=(points, points))
    return connected_components(edges, directed=False)[1].astype(np.int64)


def triangle_areas(
    points_m: NDArray[np.float32], triangles: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Compute the area of each triangle: (T,) float64. points_m: (V, 3) float32. triangles: (T, 3)
    int32.
    """
    a, b, c = (points_m[triangles[:, k]].astype(np.float64).T for k in range(3))
    (x, y, z), (u, v, w) = b - a, c - a
    doubled = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
    return np.asarray(doubled / 2)
