"""A triangle mesh with colors, as all products of a map are made of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.surface.connected_parts import connected_parts, triangle_areas


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
    """Find the points that indices, such as triangles (T, 3), use, of ``points`` in all: their
    numbers, and the indices by positions in these.
    """
    used = np.zeros(points, np.bool_)
    used[indices] = True
    places = np.cumsum(used, dtype=np.int64) - 1
    return np.flatnonzero(used), places[indices].astype(np.int32)
