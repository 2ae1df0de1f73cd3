"""Connected parts of a mesh, and how large they are."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled


@compiled
def connected_parts(triangles: Any, points: int) -> Any:
    """Number the connected parts of a mesh from 0, as they come: (V,) int64, the part of each of so many points.

    triangles: (T, 3) int32. Union-find with path halving; the lowest point of a part stands for it.
    """
    root = np.arange(points)
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


@compiled
def triangle_areas(points_m: Any, triangles: Any) -> Any:
    """Compute the area of each triangle: (T,) float64. points_m: (V, 3) float32. triangles: (T, 3) int32."""
    areas = np.empty(len(triangles))
    for t in range(len(triangles)):
        a, b, c = points_m[triangles[t, 0]], points_m[triangles[t, 1]], points_m[triangles[t, 2]]
        x, y, z = np.float64(b[0]) - a[0], np.float64(b[1]) - a[1], np.float64(b[2]) - a[2]
        u, v, w = np.float64(c[0]) - a[0], np.float64(c[1]) - a[1], np.float64(c[2]) - a[2]
        areas[t] = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2) / 2
    return areas
