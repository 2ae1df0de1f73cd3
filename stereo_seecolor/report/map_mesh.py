"""Pieces of a map's mesh for the page: packed into scripts."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.report.number_code import coded


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
        """``middles`` of its triangles."""
        return middles(self.points_m, self.triangles)

    def packed(self, step_m: float) -> dict[str, Any]:
        """The piece as the page reads it."""
        colors = packed_colors(self.colors, self.rim)
        return packed_surface(self.points_m, self.triangles, step_m) | {"colors": colors}


def packed_surface(
    points_m: NDArray[np.float32], triangles: NDArray[np.int64], step_m: float
) -> dict[str, Any]:
    """Vertices (N, 3) and triangles (T, 3) as the page reads them."""
    # steps of one grid for all tiles: what two of them share stays in one place, without cracks
    steps = np.rint(points_m.astype(np.float64) / step_m).astype(np.int64)
    low = steps.min(axis=0)
    return {
        "low_m": [float(value) for value in low * step_m],
        "step_m": [step_m] * 3,
        "positions": coded((steps - low).T),
        "corners": coded(triangles, repeats=True),
    }


def packed_colors(colors: NDArray[np.uint8], rim: NDArray[np.bool_]) -> bytes:
    """Colors (N, 3) as the page reads them, in steps; darker where the mesh ends (N,). Red and blue
    as their differences from green, with which they vary.
    """
    shaded = np.where(rim[:, None], np.maximum(colors.astype(np.int64) - RIM_SHADE, 0), colors)
    red, green, blue = (shaded // SIZES.color_step).T
    return coded(np.stack([red - green, green, blue - green]))


def middles(points_m: NDArray[np.float32], triangles: NDArray[np.int64]) -> NDArray[np.float32]:
    """x and y of the middle of each triangle (T, 3), (T, 2)."""
    a, b, c = (points_m[corner, :2] for corner in triangles.T)
    # a fifth of the time of a mean over an axis of three
    return np.asarray((a + b + c) / 3, np.float32)


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
