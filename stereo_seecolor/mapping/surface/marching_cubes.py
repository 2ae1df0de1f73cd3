"""Marching cubes over blocks of voxels, a range of blocks at a time: the cubes' cases, then the
points, then the triangles.

Arrays: keys (B, 3) int32 coordinates of the blocks, sorted. around (B, 27) int32: the numbers of a
block's neighbors and its own, x fastest, -1 where there is none. tsdf, weight: as in kernels.py.
cases (B, 8, 8, 8) uint8: which corners of the cube above each voxel lie inside the surface; 0 as
well where one is not known. numbers (B, 8, 8, 8, 3) int32: of the point on the edge from a voxel
along x, y and z, -1 where there is none. Indices are z, y, x everywhere.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.surface.kernels import BLOCK, packed

WIDE = BLOCK + 3
"""A block with one voxel before it and two behind it along each axis."""


def neighbors(keys: Any, around: Any, first: int, last: int) -> None:
    """Write ``around`` of the blocks from first to last - 1."""
    x, y, z = keys.astype(np.int64).T
    sorted_keys, part = packed(x, y, z), slice(first, last)
    for n in range(27):
        key = packed(x[part] + n % 3 - 1, y[part] + n // 3 % 3 - 1, z[part] + n // 9 - 1)
        found = np.searchsorted(sorted_keys, key)
        there = sorted_keys[np.minimum(found, len(sorted_keys) - 1)] == key
        around[part, n] = np.where(there, found, -1)


@compiled
def _place(b: Any, k: Any, j: Any, i: Any, around: Any) -> Any:
    """The block, and the place in it, of the voxel (k, j, i) of block b, where these may be -1 to
    two past the block's edge.
    """
    n = (i + BLOCK) // BLOCK + 3 * ((j + BLOCK) // BLOCK) + 9 * ((k + BLOCK) // BLOCK)
    return around[b, n], k % BLOCK, j % BLOCK, i % BLOCK


@compiled
def _gather(b: Any, around: Any, tsdf: Any, weight: Any, least: Any, low: int, wide: Any) -> None:
    """Signed distances of a block and of the voxels around it from ``low`` on into wide (w, w, w);
    NaN where weights are low.
    """
    size = len(wide)
    for k in range(size):
        for j in range(size):
            for i in range(size):
                block, z, y, x = _place(b, k + low, j + low, i + low, around)
                known = block >= 0 and weight[block, z, y, x] > least
                wide[k, j, i] = tsdf[block, z, y, x] if known else np.float32(np.nan)


@compiled
def find_cases(
    own: Any,
    around: Any,
    tsdf: Any,
    weight: Any,
    least: float,
    tables: Any,
    found: Any,
    first: int,
    last: int,
) -> None:
    """Write the cases of all cubes of the blocks own[first:last], mark the edges that have points,
    and count the triangles.

    least: weight that a voxel must exceed. tables: counts (256,), edges (256, 5, 3) of
    ``cube_cases`` and the EDGES (12, 4).
    found: cases, numbers and triangles (B,), changed in place; numbers become 0 where there is a
    point. Other parts may write the same zeros into blocks between theirs and this one's.
    """
    counts, edges, ends = tables
    cases, numbers, triangles = found
    wide = np.empty((BLOCK + 1, BLOCK + 1, BLOCK + 1), np.float32)
    for b in own[first:last]:
        _gather(b, around, tsdf, weight, least, 0, wide)
        for k in range(BLOCK):
            for j in range(BLOCK):
                for i in range(BLOCK):
                    case = _case(wide, k, j, i)
                    cases[b, k, j, i] = case
                    triangles[b] += counts[case]
                    for t in range(counts[case]):
                        for c in range(3):
                            e = ends[edges[case, t, c]]
                            block, z, y, x = _place(b, k + e[2], j + e[1], i + e[0], around)
                            numbers[block, z, y, x, e[3]] = 0


@compiled
def _case(wide: Any, k: Any, j: Any, i: Any) -> Any:
    case = 0
    for corner in range(8):
        value = wide[k + (corner >> 2), j + (corner >> 1 & 1), i + (corner & 1)]
        if np.isnan(value):
            return 0
        case |= (value < 0) << corner
    return case if case < 255 else 0


def count_points(numbers: Any, counts: Any, first: int, last: int) -> None:
    """Add the number of points of the blocks from first to last - 1 to counts (B,)."""
    counts[first:last] += np.count_nonzero(numbers[first:last] >= 0, axis=(1, 2, 3, 4))


@compiled
def place_points(
    keys: Any,
    around: Any,
    volume: Any,
    least: float,
    voxel_m: float,
    numbers: Any,
    starts: Any,
    points: Any,
    first: int,
    last: int,
) -> None:
    """Number the points of the blocks from first to last - 1; write positions, normals and colors.

    volume: tsdf, weight, color (B, 8, 8, 8, 3) and color_weight. starts: (B,) the number of each
    block's first point. points: positions (V, 3) float32, meters; unit normals (V, 3) float32,
    towards free space; colors (V, 3) uint8.
    """
    tsdf, weight, color, color_weight = volume
    positions, normals, colors = points
    wide = np.empty((WIDE, WIDE, WIDE), np.float32)
    for b in range(first, last):
        n = starts[b]
        gathered = False
        for k, j, i, axis in np.ndindex((BLOCK, BLOCK, BLOCK, 3)):
            if numbers[b, k, j, i, axis] < 0:
                continue
            if not gathered:
                _gather(b, around, tsdf, weight, least, -1, wide)
                gathered = True
            z, y, x = k + (axis == 2), j + (axis == 1), i + (axis == 0)
            low, high = wide[k + 1, j + 1, i + 1], wide[z + 1, y + 1, x + 1]
            t = np.float64(low) / (np.float64(low) - np.float64(high))
            numbers[b, k, j, i, axis] = n
            positions[n, 0] = (keys[b, 0] * BLOCK + i + t * (axis == 0)) * voxel_m
            positions[n, 1] = (keys[b, 1] * BLOCK + j + t * (axis == 1)) * voxel_m
            positions[n, 2] = (keys[b, 2] * BLOCK + k + t * (axis == 2)) * voxel_m
            _normal(wide, (k + 1, j + 1, i + 1), (z + 1, y + 1, x + 1), t, normals[n])
            block, z, y, x = _place(b, z, y, x, around)
            share = (1 - t) * (color_weight[b, k, j, i] > 0), t * (color_weight[block, z, y, x] > 0)
            _mix(color[b, k, j, i], color[block, z, y, x], share, colors[n])
            n += 1


@compiled
def _normal(wide: Any, a: Any, b: Any, t: float, normal: Any) -> None:
    """The direction of the gradient of the signed distance between two voxels, of those voxels
    around that are known.
    """
    squares = 0.0
    for axis in range(3):
        normal[axis] = (1 - t) * _slope(wide, a, axis) + t * _slope(wide, b, axis)
        squares += normal[axis] * normal[axis]
    for axis in range(3):
        normal[axis] /= max(np.sqrt(squares), 1e-12)


@compiled
def _slope(wide: Any, at: Any, axis: int) -> Any:
    """By central differences; by one-sided ones where one neighbor is not known."""
    k, j, i = at
    z, y, x = axis == 2, axis == 1, axis == 0
    here, before, behind = wide[k, j, i], wide[k - z, j - y, i - x], wide[k + z, j + y, i + x]
    if np.isnan(before):
        return np.float32(0) if np.isnan(behind) else behind - here
    return here - before if np.isnan(behind) else (behind - before) / np.float32(2)


@compiled
def _mix(a: Any, b: Any, share: Any, color: Any) -> None:
    """Colors of two voxels; one that was only seen through must not darken the other's."""
    total = max(share[0] + share[1], 1e-12)
    for c in range(3):
        color[c] = np.uint8(min(max((share[0] * a[c] + share[1] * b[c]) / total + 0.5, 0.0), 255.0))


@compiled
def list_triangles(
    own: Any, around: Any, tables: Any, found: Any, starts: Any, indices: Any, first: int, last: int
) -> None:
    """Write the triangles of the blocks own[first:last] to indices (T, 3) int32. starts: (B,) the
    first one of each block.
    """
    counts, edges, ends = tables
    cases, numbers = found
    for b in own[first:last]:
        n = starts[b]
        for k, j, i in np.ndindex((BLOCK, BLOCK, BLOCK)):
            case = cases[b, k, j, i]
            for t in range(counts[case]):
                for c in range(3):
                    e = ends[edges[case, t, c]]
                    block, z, y, x = _place(b, k + e[2], j + e[1], i + e[0], around)
                    indices[n, c] = numbers[block, z, y, x, e[3]]
                n += 1
