"""Pieces of a map's mesh for the page: packed into scripts."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.deflate import deflated


@dataclass(frozen=True)
class MeshSizes:
    """Sizes of tiles and steps of the packed numbers."""

    # of the coarsest level: drawn thirty times a second without a graphics card
    first_triangles: int = 30_000
    tile_triangles: int = 150_000  # loaded in a tenth of a second
    # of positions: no edge is seen to move, and half the bytes of 16 bits a tile
    steps_per_voxel: int = 16
    color_step: int = 4  # of 255: noise hides it, and colors take 40 % less


RIM_SHADE = 110
"""Of 255: so much darker is a surface where it ends, over the last cell: seen on sand and on
corals.
"""

SIZES = MeshSizes()


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a mesh. points_m: (N, 3) float32. colors: (N, 3) uint8 sRGB. triangles: (T, 3).

    rim: (N,) whether the mesh as a whole ends at a point.
    """

    points_m: NDArray[np.float32]
    colors: NDArray[np.uint8]
    triangles: NDArray[np.int64]
    rim: NDArray[np.bool_]

    @cached_property
    def middles_m(self) -> NDArray[np.float32]:
        """x and y of the middle of each triangle, (T, 2)."""
        a, b, c = (self.points_m[corner, :2] for corner in self.triangles.T)
        return np.asarray((a + b + c) / 3)  # a fifth of the time of a mean over an axis of three

    def of(self, chosen: NDArray[np.int64]) -> "Piece":
        """The triangles of these numbers, with their vertices."""
        used, triangles = np.unique(self.triangles[chosen], return_inverse=True)
        return Piece(
            self.points_m[used], self.colors[used], triangles.reshape(-1, 3), self.rim[used]
        )

    def in_strips(self, strip_m: float) -> "Piece":
        """The piece with triangles ordered by strips across the map, and vertices in the order in
        which triangles use them.
        """
        vertices, triangles = in_strips(self, strip_m)
        return Piece(self.points_m[vertices], self.colors[vertices], triangles, self.rim[vertices])

    def packed(self, step_m: float) -> dict[str, Any]:
        """The piece as the page reads it: differences of positions between vertices, in steps;
        indices relative to the newest.
        """
        return packed_surface(self.points_m, self.triangles, step_m) | {
            "colors": packed_colors(self.colors, self.rim)
        }


def in_strips(piece: Piece, strip_m: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the vertices of a piece in the order in which triangles use them, and the
    triangles, ordered by strips across the map, with the vertices' new numbers.
    """
    strips = np.floor(piece.middles_m[:, 1] / strip_m).astype(np.int64)
    walked = piece.triangles[np.lexsort((piece.middles_m[:, 0], strips))]
    vertices, triangles = _by_first_use(walked)
    again, triangles = _by_first_use(_newest_first(triangles))
    return vertices[again], triangles


def packed_surface(
    points_m: NDArray[np.float32], triangles: NDArray[np.int64], step_m: float
) -> dict[str, Any]:
    """Vertices (N, 3) and triangles (T, 3), whose vertices come in the order in which triangles use
    them, as the page reads them.
    """
    # steps of one grid for all tiles: what two of them share stays in one place, without cracks
    steps = np.rint(points_m.astype(np.float64) / step_m).astype(np.int64)
    low = steps.min(axis=0)
    indices = triangles.ravel()
    newest = np.maximum.accumulate(np.concatenate([[-1], indices[:-1]]))
    return {
        "vertices": len(points_m),
        "triangles": len(triangles),
        "low_m": [float(value) for value in low * step_m],
        "step_m": step_m,
        "positions": packed_steps(steps - low),
        "indices": deflated(_bytes((newest + 1 - indices).astype(np.uint64), 3), repeats=True),
    }


def packed_steps(steps: NDArray[np.int64]) -> bytes:
    """Whole numbers (N, C) of less than 23 bits as differences from row to row."""
    return deflated(_planes(np.diff(steps, axis=0, prepend=0).T.ravel(), 3), repeats=True)


def packed_colors(colors: NDArray[np.uint8], rim: NDArray[np.bool_]) -> bytes:
    """Colors (N, 3) as the page reads them, in steps; darker where the mesh ends (N,)."""
    shaded = np.where(rim[:, None], np.maximum(colors.astype(np.int64) - RIM_SHADE, 0), colors)
    steps = (shaded // SIZES.color_step) * SIZES.color_step + SIZES.color_step // 2
    return deflated(np.diff(steps.T.astype(np.uint8), axis=1, prepend=np.uint8(0)).tobytes())


def _by_first_use(triangles: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The vertices in the order in which triangles (T, 3) use them, and the triangles with the
    vertices' new numbers.
    """
    uses = triangles.ravel()
    first = np.full(int(uses.max()) + 1, -1)
    first[uses[::-1]] = np.arange(len(uses))[::-1]  # of equal indices the last one stays
    begins = np.zeros(len(uses), bool)
    begins[first[first >= 0]] = True
    order = uses[begins]
    place = np.empty_like(first)
    place[order] = np.arange(len(order))
    return order, place[triangles]


def _newest_first(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """The triangles, each starting at its highest vertex: neighbors are then similar, and compress
    better.
    """
    corners = (np.arange(3) + triangles.argmax(axis=1)[:, None]) % 3
    return np.take_along_axis(triangles, corners, axis=1)


def _planes(differences: NDArray[np.int64], count: int) -> bytes:
    """``count`` bytes of each number of either sign, the lowest of all first."""
    return _bytes(((differences << 1) ^ (differences >> 63)).astype(np.uint64), count)


def _bytes(numbers: NDArray[np.uint64], count: int) -> bytes:
    planes = [(numbers >> np.uint64(8 * i)) & np.uint64(255) for i in range(count)]
    return np.stack(planes).astype(np.uint8).tobytes()


def rim_of(triangles: NDArray[np.int64], points: int) -> NDArray[np.bool_]:
    """(points,) whether an edge of a single triangle meets a point: elsewhere each neighbor is once
    the next corner, and once the one before.
    """
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    after, before = np.bincount(start, end, points), np.bincount(end, start, points)
    return np.asarray(after != before)


def box(piece: Piece) -> dict[str, Any]:
    """Where a piece lies, and how many triangles it has, as the list of all pieces states it."""
    low, high = piece.points_m.min(axis=0), piece.points_m.max(axis=0)
    corners = {
        name: [round(float(value), 4) for value in corner]
        for name, corner in (("low_m", low), ("high_m", high))
    }
    return {**corners, "triangles": len(piece.triangles)}
