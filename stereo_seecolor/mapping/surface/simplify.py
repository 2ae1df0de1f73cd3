"""A mesh with fewer triangles, nowhere further from the original than a bound."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.surface.simplify_kernels import collapse_edges
from stereo_seecolor.mapping.surface.surface import only_used


@dataclass(frozen=True, eq=False)
class Simplified:
    """A simplified mesh. kept: (V,) numbers of the original's vertices that are left. triangles: (F, 3) int32, into ``kept``.

    largest_m, rms_m: distance of the original's vertices to the new surface.
    """

    kept: NDArray[np.int64]
    triangles: NDArray[np.int32]
    largest_m: float
    rms_m: float


def simplify(
    position_m: NDArray[np.floating], triangles: NDArray[np.integer], bound_m: float, longest_m: float = np.inf
) -> Simplified:
    """Remove vertices of a mesh, as many as the bound allows.

    position_m: (V, 3). triangles: (F, 3), a surface of any topology. bound_m: largest distance of the original's vertices to the
    new surface, and of those of its boundary to the new boundary. longest_m: no new edge is longer.
    """
    position = np.ascontiguousarray(position_m, np.float64)
    position = position - (position.mean(axis=0) if len(position) else 0)  # quadrics lose digits far from the origin
    left = np.array(triangles, np.int32, order="C")
    head, link = _corners(left, len(position))
    distance2 = collapse_edges(position, left, boundary_edges(left), head, link, bound_m, longest_m)
    left = left[left[:, 0] >= 0]
    kept, indices = only_used(left, len(position))
    in_original = np.zeros(len(position), np.bool_)
    in_original[np.asarray(triangles).ravel()] = True
    distance2 = distance2[in_original]
    largest_m = float(np.sqrt(distance2.max(initial=0)))
    rms_m = float(np.sqrt(distance2.mean())) if len(distance2) else 0.0
    return Simplified(kept, indices, largest_m, rms_m)


def boundary_edges(triangles: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Mark the edges that not exactly two triangles share: (F, 3) bool of triangles (F, 3); edge k runs from corner k to k + 1."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64), axis=1)
    _, inverse, count = np.unique(ends[:, 0] << 32 | ends[:, 1], return_inverse=True, return_counts=True)
    return np.asarray(count[inverse] != 2).reshape(-1, 3)


def _corners(triangles: NDArray[np.int32], vertices: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The corners at each vertex as linked lists: the first (V,), and the next (3 F,)."""
    head, link = np.full(vertices, -1, np.int32), np.full(triangles.size, -1, np.int32)
    flat = triangles.ravel()
    order = np.argsort(flat, kind="stable").astype(np.int32)
    same = flat[order][1:] == flat[order][:-1]
    link[order[:-1][same]] = order[1:][same]
    starts = np.concatenate([[True], ~same]) if len(order) else np.zeros(0, np.bool_)
    head[flat[order[starts]]] = order[starts]
    return head, link
