"""Extraction of the surface from a tile's voxels by marching cubes, on all cores."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.mapping.surface.cube_cases import EDGES, cube_cases
from stereo_seecolor.mapping.surface.kernels import BLOCK
from stereo_seecolor.mapping.surface.marching_cubes import (
    count_points,
    find_cases,
    list_triangles,
    neighbors,
    place_points,
)
from stereo_seecolor.mapping.surface.surface import Surface

MIN_WEIGHT = 0.05
"""A surface is kept from this sum of weights: a standard error of four voxels, seen once."""


@dataclass(frozen=True, eq=False)
class Volume:
    """A tile's voxels. blocks: (B, 3) int32 coordinates, sorted. tsdf: signed distance in units of
    the truncation; weight: its weight, both (B, 8, 8, 8) float32, index z, y, x. color: (B, 8, 8,
    8, 3) float32, 0..255; color_weight: (B, 8, 8, 8) float32.
    """

    blocks: NDArray[np.int32]
    voxel_m: float
    tsdf: NDArray[np.float32]
    weight: NDArray[np.float32]
    color: NDArray[np.float32]
    color_weight: NDArray[np.float32]

    @classmethod
    def empty(cls, blocks: NDArray[np.int32], voxel_m: float) -> "Volume":
        """Make the voxels of these blocks, with nothing measured in any."""
        shape = (len(blocks), BLOCK, BLOCK, BLOCK)
        tsdf, weight, color_weight = (np.zeros(shape, np.float32) for _ in range(3))
        return cls(blocks, voxel_m, tsdf, weight, np.zeros((*shape, 3), np.float32), color_weight)


PART_BLOCKS = 64
"""Blocks that a core works on at once: some milliseconds."""


def extract(volume: Volume, own: NDArray[np.int64]) -> Surface:
    """The surface: where the signed distance is zero and all eight voxels around have weight.

    own: (b,) numbers of the blocks whose cubes are searched. The cubes of a block reach to the
    first voxels of the next block: each belongs to one block. So tiles that share no own block
    share no triangle, and their points on the plane between them are equal to the bit. Points and
    triangles come in the order of the blocks, whatever the number of cores.
    """
    blocks = len(volume.blocks)
    around = np.empty((blocks, 27), np.int32)
    in_parts(partial(neighbors, volume.blocks, around), blocks, PART_BLOCKS)
    cubes = _Cubes.of(volume, own, around)
    counts = np.zeros(blocks, np.int64)
    in_parts(partial(count_points, cubes.numbers, counts), blocks, PART_BLOCKS)
    starts, points = _starts(counts), int(counts.sum())
    positions, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    colors = np.empty((points, 3), np.uint8)
    voxels = volume.tsdf, volume.weight, volume.color, volume.color_weight
    place = partial(
        place_points, volume.blocks, around, voxels, MIN_WEIGHT, volume.voxel_m, cubes.numbers,
        starts, (positions, normals, colors),
    )  # fmt: skip
    in_parts(place, blocks, PART_BLOCKS)  # it numbers the points, which the triangles refer to
    return Surface(positions, normals, colors, cubes.triangles(own, around))


@dataclass(frozen=True, eq=False)
class _Cubes:
    """The cubes of a tile. cases, numbers: see extraction.py. counts: (B,) triangles a block."""

    cases: NDArray[np.uint8]
    numbers: NDArray[np.int32]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, volume: Volume, own: NDArray[np.int64], around: NDArray[np.int32]) -> "_Cubes":
        """The case of each cube; ``numbers`` is 0 on each edge with a point, -1 on others."""
        cases = np.empty(volume.tsdf.shape, np.uint8)
        numbers = np.full((*volume.tsdf.shape, 3), -1, np.int32)
        counts = np.zeros(len(volume.blocks), np.int64)
        tables, found = (*cube_cases(), EDGES), (cases, numbers, counts)
        voxels = volume.tsdf, volume.weight, MIN_WEIGHT
        in_parts(partial(find_cases, own, around, *voxels, tables, found), len(own), PART_BLOCKS)
        return cls(cases, numbers, counts)

    def triangles(self, own: NDArray[np.int64], around: NDArray[np.int32]) -> NDArray[np.int32]:
        """The points of each triangle, (T, 3), once ``numbers`` holds the points' numbers."""
        starts = _starts(self.counts)
        tables, found = (*cube_cases(), EDGES), (self.cases, self.numbers)
        indices = np.empty((self.counts.sum(), 3), np.int32)
        listed = partial(list_triangles, own, around, tables, found, starts, indices)
        in_parts(listed, len(own), PART_BLOCKS)
        return indices


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(B,) the number of each block's first item, where the blocks hold so many each."""
    starts = np.zeros(len(counts), np.int64)
    starts[1:] = np.cumsum(counts)[:-1]
    return starts
