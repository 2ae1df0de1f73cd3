"""A triangle mesh with colors, as all products of a map are made of it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled

# Connected parts of a mesh, and how large they are.


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


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh. points_m, normals: (V, 3) float32; colors: (V, 3) uint8; triangles: (T, 3)
    int32.
    """

    points_m: NDArray[np.float32]
    normals: NDArray[np.float32]
    colors: NDArray[np.uint8]
    triangles: NDArray[np.int32]

    @classmethod
    def empty(cls) -> "Surface":
        """Make a mesh without points."""
        none = np.zeros((0, 3), np.float32)
        return cls(none, none, np.zeros((0, 3), np.uint8), np.zeros((0, 3), np.int32))

    @property
    def parts(self) -> NDArray[np.int64]:
        """The connected part of the surface that each point belongs to: (V,) int64, numbered from
        0.
        """
        parts: NDArray[np.int64] = connected_parts(self.triangles, len(self.points_m))
        return parts

    @property
    def areas_m2(self) -> NDArray[np.float64]:
        """The area of each triangle: (T,) float64."""
        areas: NDArray[np.float64] = triangle_areas(self.points_m, self.triangles)
        return areas

    def only(self, kept: NDArray[np.bool_]) -> "Surface":
        """Select the points that are kept (V,), and the triangles whose first point is; all points
        of a triangle must be kept, or none.
        """
        numbers = np.cumsum(kept) - 1
        triangles = self.triangles[kept[self.triangles[:, 0]]]
        return Surface(
            self.points_m[kept],
            self.normals[kept],
            self.colors[kept],
            numbers[triangles].astype(np.int32),
        )


def only_used(
    indices: NDArray[np.integer], points: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Find the points that triangles (T, 3) use, of ``points`` in all: their numbers, and the
    triangles by positions in these.
    """
    used = np.zeros(points, np.bool_)
    used[indices] = True
    places = np.cumsum(used, dtype=np.int64) - 1
    return np.flatnonzero(used), places[indices].astype(np.int32)
