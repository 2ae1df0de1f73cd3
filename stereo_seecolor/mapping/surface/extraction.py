"""The surface in a tile's voxels, on all cores."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.mapping.surface.cube_cases import EDGES, cube_cases
from stereo_seecolor.mapping.surface.extraction_kernels import (
    count_points,
    find_cases,
    list_triangles,
    neighbors,
    place_points,
)
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.volume import MIN_WEIGHT, Volume

PART_BLOCKS = 64
"""That a core works on at once: some milliseconds."""


def extract(volume: Volume, own: NDArray[np.int64]) -> Surface:
    """The triangles where the signed distance is zero and all eight voxels around have weight, in the cubes of some blocks.

    own: the numbers of the blocks. The cubes of a block reach to the first voxels of the next: each belongs to one block, and
    tiles that share no own block share no triangle, and the points on the plane between them to the bit. Points and triangles come
    in the order of the blocks, whatever the number of cores.
    """
    blocks = len(volume.blocks)
    around = np.empty((blocks, 27), np.int32)
    in_parts(lambda a, b: neighbors(volume.blocks, around, a, b), blocks, PART_BLOCKS)
    cubes = _Cubes.of(volume, own, around)
    points, starts = np.zeros(blocks, np.int64), np.zeros(blocks, np.int64)
    in_parts(lambda a, b: count_points(cubes.numbers, points, a, b), blocks, PART_BLOCKS)
    starts[1:] = np.cumsum(points)[:-1]
    placed = np.empty((points.sum(), 3), np.float32), np.empty((points.sum(), 3), np.float32), np.empty((points.sum(), 3), np.uint8)
    voxels = volume.tsdf, volume.weight, volume.color, volume.color_weight
    where = volume.blocks, around, voxels, MIN_WEIGHT, volume.voxel_m, cubes.numbers, starts, placed
    in_parts(lambda a, b: place_points(*where, a, b), blocks, PART_BLOCKS)
    return Surface(*placed, cubes.triangles(own, around))


@dataclass(frozen=True, eq=False)
class _Cubes:
    """cases, numbers: as in extraction_kernels.py. counts: (B,) how many triangles each block has."""

    cases: NDArray[np.uint8]
    numbers: NDArray[np.int32]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, volume: Volume, own: NDArray[np.int64], around: NDArray[np.int32]) -> "_Cubes":
        """The edges that have a point are marked by 0."""
        cubes = cls(
            np.empty(volume.tsdf.shape, np.uint8),
            np.full((*volume.tsdf.shape, 3), -1, np.int32),
            np.zeros(len(volume.blocks), np.int64),
        )
        found = cubes.cases, cubes.numbers, cubes.counts
        voxels = volume.tsdf, volume.weight, MIN_WEIGHT
        in_parts(lambda a, b: find_cases(own, around, *voxels, _tables(), found, a, b), len(own), PART_BLOCKS)
        return cubes

    def triangles(self, own: NDArray[np.int64], around: NDArray[np.int32]) -> NDArray[np.int32]:
        """(T, 3), once the points are numbered."""
        starts = np.zeros(len(self.counts), np.int64)
        starts[1:] = np.cumsum(self.counts)[:-1]
        found = self.cases, self.numbers
        indices = np.empty((self.counts.sum(), 3), np.int32)
        in_parts(lambda a, b: list_triangles(own, around, _tables(), found, starts, indices, a, b), len(own), PART_BLOCKS)
        return indices


def _tables() -> tuple[NDArray[np.int8], NDArray[np.int8], NDArray[np.int64]]:
    return *cube_cases(), EDGES
