"""A triangle mesh with colors, as all products of a map are made of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh. points_m, normals: (V, 3); colors: (V, 3) uint8; triangles: (T, 3)."""

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
        """The connected part of the surface that each point is of: (V,) int64, from 0."""
        # a tenth of a second that runs without a map, whose page imports this, need not wait for
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        one, other = self.triangles[:, :2].ravel(), self.triangles[:, 1:].ravel()
        joined, count = np.ones(len(one), np.int8), len(self.points_m)
        edges = csr_array((joined, (one, other)), shape=(count, count))
        return connected_components(edges, directed=False)[1].astype(np.int64)

    @property
    def areas_m2(self) -> NDArray[np.float64]:
        """The area of each triangle: (T,) float64."""
        a, b, c = (self.points_m[self.triangles[:, k]].astype(np.float64).T for k in range(3))
        (x, y, z), (u, v, w) = b - a, c - a
        doubled = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
        return np.asarray(doubled / 2)

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
    """Find the points that indices, such as triangles (T, 3), use, of ``points`` in all: their
    numbers, and the indices by positions in these.
    """
    used = np.zeros(points, np.bool_)
    used[indices] = True
    places = np.cumsum(used, dtype=np.int64) - 1
    return np.flatnonzero(used), places[indices].astype(np.int32)
