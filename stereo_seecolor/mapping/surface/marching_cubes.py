"""Triangles of a tile's voxels by scikit-image, where Open3D is missing: the same surface to a small part of a voxel."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.surface import only_used
from stereo_seecolor.mapping.surface.volume import MIN_WEIGHT, Triangles, Volume

CHUNK = 8
"""Blocks along the edge of what is extracted at once, 65^3 voxels: little of it is empty, and few calls are made."""

Float = NDArray[np.float64]


def extract(volume: Volume) -> Triangles | None:
    """The triangles where the signed distance is zero and all eight voxels around have weight; None where there are none.

    Marching cubes (Lorensen and Cline 1987), chunk by chunk; chunks lie on a grid of their own, so that neighboring tiles put
    the points between them to the same place, to the bit.
    """
    points, indices, count = [], [], 0
    for corner, tsdf, known in _chunks(volume):
        found = _chunk_triangles(tsdf, known)
        if found is not None:
            points.append((found[0] + corner) * volume.voxel_m)
            indices.append(found[1] + count)
            count += len(found[0])
    if not points:
        return None
    unique, numbers = np.unique(np.concatenate(points).astype(np.float32), axis=0, return_inverse=True)
    triangles = numbers.reshape(-1)[np.concatenate(indices)]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]  # float32 may have brought two corners together
    return Triangles(unique, _normals(unique, triangles), triangles.astype(np.int64)) if len(triangles) else None


def _chunks(volume: Volume) -> Iterator[tuple[Float, NDArray[np.float32], NDArray[np.bool_]]]:
    """Of each chunk the voxel of its corner, its signed distances (65, 65, 65), index x, y, z, and where they are known.

    The last voxel along each axis is the first of the next chunk.
    """
    size = CHUNK * BLOCK + 1
    blocks = volume.blocks.astype(np.int64)
    of_chunk: dict[tuple[int, ...], list[int]] = {}
    for number, block in enumerate(blocks):
        low, high = block // CHUNK, (block - 1) // CHUNK  # a block at a chunk's start is the last one's end
        for place in {(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])}:
            of_chunk.setdefault(tuple(int(n) for n in place), []).append(number)
    for where, numbers in sorted(of_chunk.items()):
        chunk = np.array(where, np.int64)
        tsdf, weight = np.ones((size,) * 3, np.float32), np.zeros((size,) * 3, np.float32)
        for number in numbers:
            start = (blocks[number] - chunk * CHUNK) * BLOCK
            here = tuple(slice(int(s), min(int(s) + BLOCK, size)) for s in start)
            part = tuple(slice(0, s.stop - s.start) for s in here)
            tsdf[here] = volume.tsdf[number].transpose(2, 1, 0)[part]
            weight[here] = volume.weight[number].transpose(2, 1, 0)[part]
        yield chunk.astype(np.float64) * (CHUNK * BLOCK), tsdf, weight > MIN_WEIGHT


def _chunk_triangles(tsdf: NDArray[np.float32], known: NDArray[np.bool_]) -> tuple[Float, NDArray[np.int64]] | None:
    """Points in voxels, and triangles, inside cubes of which all eight corners are known."""
    from skimage import measure

    find: Any = measure.marching_cubes  # not typed
    if not ((tsdf < 0) & known).any():
        return None
    cubes = known[:-1, :-1, :-1].copy()
    for x, y, z in np.ndindex(2, 2, 2):
        cubes &= known[x : x + len(cubes), y : y + len(cubes), z : z + len(cubes)]
    filled = np.where(known, tsdf, np.float32(1))
    points, triangles, *_ = find(filled, 0.0, gradient_direction="descent", method="lorensen")
    cube = np.floor(points[triangles].mean(axis=1, dtype=np.float64)).astype(np.int64)
    own = cubes[tuple(np.minimum(cube, len(cubes) - 1).T)]
    used, renumbered = only_used(triangles[own].astype(np.int64), len(points))
    return (points[used].astype(np.float64), renumbered.astype(np.int64)) if len(used) else None


def _normals(points_m: NDArray[np.float32], triangles: NDArray[np.int64]) -> NDArray[np.float32]:
    """(V, 3) unit normals: the mean of the triangles around a point, weighted by their areas."""
    a, b, c = np.moveaxis(points_m[triangles].astype(np.float64), 1, 0)
    across = np.cross(b - a, c - a)
    sums = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(across[:, k], 3), minlength=len(points_m)) for k in range(3)], axis=-1
    )
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-30), np.float32)
