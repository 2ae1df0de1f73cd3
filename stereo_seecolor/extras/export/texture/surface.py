"""The mesh that is textured: the map's, with as few triangles as a bound allows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.texture.simplify import simplify
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.run_folder.layout import MESH
from stereo_seecolor.run_folder.posed_run import PosedRun

BOUND_VOXELS = 0.5
"""Of the bound, in voxels of the map: finer than its surface was sampled."""
LONGEST = 0.1
"""Of an edge, as a fraction of the images' lower side on the bottom: a triangle is to lie in one
image as a whole.
"""


@dataclass(frozen=True, eq=False)
class Surface:
    """position (V, 3) float64 meters, map coordinates; normal (V, 3) float32, color (V, 3) uint8;
    triangles (F, 3) int32.

    bound_m: how far it may be from the map's own surface. largest_m, rms_m: how far the vertices of
    that one are from it.
    original: how many triangles that one has.
    """

    position: NDArray[np.float64]
    normal: NDArray[np.float32]
    color: NDArray[np.uint8]
    triangles: NDArray[np.int32]
    bound_m: float
    largest_m: float
    rms_m: float
    original: int

    def simplified(self, bound_m: float, longest_m: float) -> "Surface":
        """Simplify further: ``bound_m`` further away at most, no new edge longer than
        ``longest_m``.
        """
        found = simplify(self.position, self.triangles, bound_m, longest_m)
        return Surface(
            self.position[found.kept],
            self.normal[found.kept],
            self.color[found.kept],
            found.triangles,
            self.bound_m + bound_m,
            self.largest_m + found.largest_m,
            self.rms_m + found.rms_m,
            self.original,
        )


def read_surface(posed: PosedRun) -> Surface:
    """The run's mesh, simplified within half a voxel."""
    longest_m = longest_edge_m(posed)
    path = posed.map_folder / MESH
    vertices, triangles = read_vertices(path), np.array(read_triangles(path)["indices"], np.int32)
    arrays = (
        np.array(vertices["position"], np.float64),
        np.array(vertices["normal"]),
        np.array(vertices["color"]),
    )
    return Surface(*arrays, triangles, 0.0, 0.0, 0.0, len(triangles)).simplified(
        BOUND_VOXELS * posed.voxel_m, longest_m
    )


def longest_edge_m(posed: PosedRun) -> float:
    """The longest edge of a triangle that one image can hold."""
    return LONGEST * min(posed.geometry.image_size) * posed.pixel_m


def neighbors(triangles: NDArray[np.int32]) -> NDArray[np.int64]:
    """Find the triangle across each edge, k from corner k to k + 1: (F, 3); -1 at the boundary, and
    where more than two meet.
    """
    ends = np.sort(
        np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1)
        .reshape(-1, 2)
        .astype(np.int64),
        axis=1,
    )
    key = ends[:, 0] << 32 | ends[:, 1]
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    pairs = starts[np.diff(np.append(starts, len(key))) == 2]
    result = np.full(len(key), -1, np.int64)
    result[order[pairs]], result[order[pairs + 1]] = order[pairs + 1] // 3, order[pairs] // 3
    return result.reshape(-1, 3)
