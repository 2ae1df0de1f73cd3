"""The map cut into square columns: which blocks of voxels each holds, and which frames reach it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.surface.kernels import BITS, BLOCK, OFFSET, packed

TRUNCATION_VOXELS = 4
"""Signed distances are kept so far from the surface: two standard errors of a range that counts at all."""
FRAMES_AT_ONCE = 64
"""Blocks of so many frames are gathered before doubles are dropped, for memory's sake."""


@dataclass(frozen=True, eq=False)
class Tile:
    """A square column of the map.

    column: (x, y) index of the tile. blocks: (B, 3) int32 coordinates of its blocks and of a rim one block wide, so that the
    surface at the edge comes out as it does in the neighbor. frames: those that can touch any of them, in order.
    """

    column: tuple[int, int]
    blocks: NDArray[np.int32]
    frames: tuple[int, ...]

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.column[0]:+d}{self.column[1]:+d}"


@dataclass(frozen=True, eq=False)
class Tiling:
    """All tiles of a map, row by row, back and forth, so that neighbors share the frames just read.

    tile_blocks: blocks along a tile's edge. columns: how many columns of blocks hold anything.
    """

    tiles: tuple[Tile, ...]
    voxel_m: float
    tile_blocks: int
    columns: int

    @property
    def tile_m(self) -> float:
        """Edge of a tile in meters, a whole number of blocks."""
        return self.tile_blocks * BLOCK * self.voxel_m


def cut(component: Component, voxel_m: float, tile_m: float) -> Tiling:
    """Find the blocks that the frames' surfaces pass through, and deal them out to tiles."""
    block_m, reach_m = BLOCK * voxel_m, TRUNCATION_VOXELS * voxel_m
    tile_blocks = int(np.clip(round(tile_m / block_m), 1, OFFSET))
    found: NDArray[np.int64] = np.zeros(0, np.int64)
    boxes: Boxes = {}
    pending: list[NDArray[np.int64]] = []
    for i in component.frames:
        points = component.points_m(int(i))
        if not len(points):
            continue
        around = np.concatenate([points, component.T_local_camera[i, None, :3, 3]])
        boxes[int(i)] = np.floor((around.min(axis=0) - reach_m) / block_m), np.floor((around.max(axis=0) + reach_m) / block_m)
        certain = component.survey.index.certain
        pending.append(_blocks_near(points[certain[i]] if certain else points, reach_m, block_m))
        if len(pending) == FRAMES_AT_ONCE:
            found, pending = np.unique(np.concatenate([found, *pending])), []
    if not boxes:
        return Tiling((), voxel_m, tile_blocks, 0)
    blocks = _unpack(np.unique(np.concatenate([found, *pending])))
    columns = len(np.unique(packed(blocks[:, 0].astype(np.int64), blocks[:, 1].astype(np.int64), 0)))
    return Tiling(tuple(_deal(blocks, boxes, tile_blocks)), voxel_m, tile_blocks, columns)


Boxes = dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]
"""The lowest and the highest block that each frame can touch."""


def _blocks_near(points: NDArray[np.float64], reach_m: float, block_m: float) -> NDArray[np.int64]:
    """Packed coordinates of all blocks within reach of the points."""
    low, high = (np.floor((points + sign * reach_m) / block_m).astype(np.int64) for sign in (-1, 1))
    lowest = packed(*low.T)
    x, y, z = (high - low).T << np.array([[2 * BITS], [BITS], [0]])
    return np.unique(np.concatenate([lowest + i * x + j * y + k * z for i, j, k in np.ndindex(2, 2, 2)]))


def _unpack(numbers: NDArray[np.int64]) -> NDArray[np.int32]:
    mask = (1 << BITS) - 1
    return (np.stack([numbers >> (2 * BITS), (numbers >> BITS) & mask, numbers & mask], axis=-1) - OFFSET).astype(np.int32)


def _deal(blocks: NDArray[np.int32], boxes: Boxes, tile_blocks: int) -> Iterator[Tile]:
    columns = np.unique(blocks[:, :2] // tile_blocks, axis=0)
    rows = columns[:, 1]
    order = np.lexsort((np.where(rows % 2 == 0, columns[:, 0], -columns[:, 0]), rows))
    low = np.array([box[0][:2] for box in boxes.values()])
    high = np.array([box[1][:2] for box in boxes.values()])
    numbers = np.array(list(boxes))
    for column in columns[order]:
        first, last = column * tile_blocks - 1, (column + 1) * tile_blocks
        inside = ((blocks[:, :2] >= first) & (blocks[:, :2] <= last)).all(axis=1)
        touching = ((high >= first) & (low <= last)).all(axis=1)
        yield Tile((int(column[0]), int(column[1])), blocks[inside], tuple(numbers[touching].tolist()))
