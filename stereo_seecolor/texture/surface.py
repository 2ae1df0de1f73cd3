"""A surface to be textured, and which of its triangles meet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class PaintedSurface:
    """position (V, 3) float64 meters, map coordinates; color (V, 3) uint8, of all frames together;
    triangles (F, 3) int32, facing outwards.

    bound_m: how far it may be from the map's own surface.
    """

    position: NDArray[np.float64]
    color: NDArray[np.uint8]
    triangles: NDArray[np.int32]
    bound_m: float


def edge_keys(triangles: NDArray[np.integer]) -> NDArray[np.int64]:
    """A number for each edge, k from corner k to k + 1, the same both ways: (3 F,) of (F, 3)."""
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    low, high = np.sort(ends.astype(np.int64), axis=1).T
    return np.asarray(low << 32 | high)


def neighbors(triangles: NDArray[np.int32]) -> NDArray[np.int64]:
    """The triangle across each edge, k from corner k to k + 1: (F, 3); -1 where not exactly one."""
    key = edge_keys(triangles)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    pairs = starts[np.diff(np.append(starts, len(key))) == 2]
    result = np.full(len(key), -1, np.int64)
    result[order[pairs]], result[order[pairs + 1]] = order[pairs + 1] // 3, order[pairs] // 3
    return result.reshape(-1, 3)
