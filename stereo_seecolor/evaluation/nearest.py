"""Nearest neighbors in a cloud, exactly, by a grid of cells."""

from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled

_BITS = 21
_HALF = 1 << (_BITS - 1)
_CELLS = 8
"""Cells along the reach."""


def nearest_distance_m(queries_m: NDArray[np.floating], points_m: NDArray[np.floating], reach_m: float) -> NDArray[np.float64]:
    """Distance of each query (N, 3) to the nearest of the points (M, 3), meters; infinite beyond ``reach_m``."""
    cell_m = reach_m / _CELLS
    points = np.asarray(points_m, np.float64)
    keys = _keys(np.floor(points / cell_m).astype(np.int64))
    order = np.argsort(keys, kind="stable")
    unique, starts = np.unique(keys[order], return_index=True)
    offsets, gaps = _offsets()
    bounds = np.append(starts, len(order))
    return np.asarray(_search(np.asarray(queries_m, np.float64), points[order], unique, bounds, offsets, gaps * cell_m, cell_m))


def _keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(((cells[:, 0] + _HALF) << (2 * _BITS)) + ((cells[:, 1] + _HALF) << _BITS) + cells[:, 2] + _HALF)


def _offsets() -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Neighboring cells, nearest first: what they add to a cell's key, and how far away they are at least, in cells."""
    steps = np.arange(-_CELLS, _CELLS + 1)
    cells = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    gaps = np.linalg.norm(np.maximum(np.abs(cells) - 1, 0), axis=1)
    order = np.argsort(gaps, kind="stable")
    offsets = (cells[:, 0] << (2 * _BITS)) + (cells[:, 1] << _BITS) + cells[:, 2]
    near = gaps[order] <= _CELLS
    return offsets[order][near], gaps[order][near]


@compiled(parallel=True)
def _search(queries: Any, points: Any, keys: Any, bounds: Any, offsets: Any, gaps_m: Any, cell_m: float) -> Any:
    result = np.full(len(queries), np.inf)
    for q in prange(len(queries)):
        x, y, z = queries[q]
        cell = np.floor(queries[q] / cell_m).astype(np.int64) + _HALF
        key = (cell[0] << (2 * _BITS)) + (cell[1] << _BITS) + cell[2]
        best = (_CELLS * cell_m) ** 2 * (1 + 1e-12)
        found = False
        for k in range(len(offsets)):
            if gaps_m[k] ** 2 > best:
                break
            slot = np.searchsorted(keys, key + offsets[k])
            if slot == len(keys) or keys[slot] != key + offsets[k]:
                continue
            for p in range(bounds[slot], bounds[slot + 1]):
                d = (x - points[p, 0]) ** 2 + (y - points[p, 1]) ** 2 + (z - points[p, 2]) ** 2
                if d <= best:
                    best, found = d, True
        result[q] = np.sqrt(best) if found else np.inf
    return result
