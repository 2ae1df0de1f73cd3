"""Surfaces that hang together, across tiles; what hangs with nothing is a fish, or a mismatch."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.surface.fusion import Surface

MIN_ISLAND_M2 = 0.05
"""Less than a sheet of paper that touches nothing else: not the bottom."""


def near_border(points_m: NDArray[np.float32], tile_m: float) -> NDArray[np.bool_]:
    """(V,) True for points that a neighboring tile may hold as well: within 2 % of a tile of its edge."""
    share = np.abs(points_m[:, :2] / tile_m - np.rint(points_m[:, :2] / tile_m))
    return np.asarray((share < 0.02).any(axis=1))


def labels(surface: Surface) -> NDArray[np.int64]:
    """(V,) which connected part of the surface each point belongs to, numbered from 0."""
    roots = _roots(len(surface.points_m), surface.triangles)
    return np.asarray(np.unique(roots, return_inverse=True)[1])


def keepers(surfaces: Iterable[Surface], tile_m: float) -> list[NDArray[np.bool_]]:
    """For each tile's surface, which of its connected parts are, with what they continue into, large enough to keep."""
    areas: list[float] = []
    parent: list[int] = []
    counts: list[int] = []
    border: dict[bytes, int] = {}

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    for surface in surfaces:
        label = labels(surface)
        first = len(parent)
        count = int(label.max(initial=-1)) + 1
        counts.append(count)
        parent += range(first, first + count)
        corners = surface.points_m[surface.triangles].astype(np.float64)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        areas += np.bincount(label[surface.triangles[:, 0]], area, minlength=count).tolist()
        for i in np.flatnonzero(near_border(surface.points_m, tile_m)):
            part = first + int(label[i])
            other = border.setdefault(surface.points_m[i].tobytes(), part)
            parent[root(part)] = root(other)
    roots = np.array([root(i) for i in range(len(parent))], dtype=np.int64)
    total = np.bincount(roots, areas, minlength=len(parent)) if len(parent) else np.zeros(0)
    kept = total[roots] >= MIN_ISLAND_M2
    if not kept.any():  # a map of scraps is better than none
        kept[:] = True
    return np.split(kept, np.cumsum(counts)[:-1]) if counts else []


@compiled
def _roots(count: int, triangles: Any) -> Any:
    """Union-find with path halving."""
    parent = np.arange(count)
    for t in range(len(triangles)):
        for k in range(1, 3):
            a, b = triangles[t, 0], triangles[t, k]
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            parent[max(a, b)] = min(a, b)
    for i in range(count):
        a = i
        while parent[a] != a:
            a = parent[a]
        parent[i] = a
    return parent


def only(surface: Surface, kept_parts: NDArray[np.bool_]) -> Surface:
    """The surface without the parts that are not kept."""
    kept = kept_parts[labels(surface)]
    numbers = np.cumsum(kept) - 1
    triangles = surface.triangles[kept[surface.triangles[:, 0]]]
    return Surface(surface.points_m[kept], surface.normals[kept], surface.colors[kept], numbers[triangles].astype(np.int32))
