"""Connected parts of a mesh, and how large they are."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled


@compiled
def connected_parts(triangles: Any, points: int) -> Any:
    """Number the connected parts of a mesh from 0, as they come: (V,) int64, the part of each of so
    many points.

    triangles: (T, 3) int32. Union-find with path halving; the lowest point of a part stands for it.
    """
    root = np.empty(points, np.int64)
    for i in range(points):  # np.arange takes numba a tenth of a second to compile
        root[i] = i
    for t in range(len(triangles)):
        a = _root(root, triangles[t, 0])
        for k in range(1, 3):
            b = _root(root, triangles[t, k])
            root[max(a, b)] = min(a, b)
            a = min(a, b)
    parts, count = np.empty(points, np.int64), 0
    for i in range(points):
        if root[i] == i:
            parts[i] = count
            count += 1
        else:
            parts[i] = parts[root[i]]  # lower, so it has its number
    return parts


@compiled
def _root(root: Any, i: Any) -> Any:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


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
