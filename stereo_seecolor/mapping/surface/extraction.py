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
    blocks, tables = len(volume.blocks), (*cube_cases(), EDGES)
    around = np.empty((blocks, 27), np.int32)
    in_parts(partial(neighbors, volume.blocks, around), blocks, PART_BLOCKS)
    cases = np.empty(volume.tsdf.shape, np.uint8)
    numbers = np.full((*volume.tsdf.shape, 3), -1, np.int32)
    counts, counts_of_triangles = np.zeros(blocks, np.int64), np.zeros(blocks, np.int64)
    find = partial(
        find_cases, own, around, volume.tsdf, volume.weight, MIN_WEIGHT, tables,
        (cases, numbers, counts_of_triangles),
    )  # fmt: skip
    in_parts(find, len(own), PART_BLOCKS)
    in_parts(partial(count_points, numbers, counts), blocks, PART_BLOCKS)
    points = int(counts.sum())
    positions, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    colors = np.empty((points, 3), np.uint8)
    voxels = volume.tsdf, volume.weight, volume.color, volume.color_weight
    place = partial(
        place_points, volume.blocks, around, voxels, MIN_WEIGHT, volume.voxel_m, numbers,
        _starts(counts), (positions, normals, colors),
    )  # fmt: skip
    in_parts(place, blocks, PART_BLOCKS)  # it numbers the points, which the triangles refer to
    triangles = np.empty((counts_of_triangles.sum(), 3), np.int32)
    starts = _starts(counts_of_triangles)
    listed = partial(list_triangles, own, around, tables, (cases, numbers), starts, triangles)
    in_parts(listed, len(own), PART_BLOCKS)
    return Surface(positions, normals, colors, triangles)


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(B,) the number of each block's first item, where the blocks hold so many each."""
    starts = np.zeros(len(counts), np.int64)
    starts[1:] = np.cumsum(counts)[:-1]
    return starts
