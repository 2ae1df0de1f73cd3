"""The map cut into square columns: which blocks of voxels each holds, and which frames reach it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.surface.kernels import BITS, BLOCK, OFFSET, packed

TRUNCATION_VOXELS = 4
"""Truncation distance of the signed distances, voxels: two standard errors of a range that counts
at all.
"""
FRAMES_AT_ONCE = 64
"""Frames whose blocks are collected before duplicates are dropped: it bounds the memory."""


@dataclass(frozen=True, eq=False)
class Tile:
    """A square column of the map.

    column: (x, y) index of the tile. blocks: (B, 3) int32 coordinates of its blocks and of a rim
    one block wide, so that the surface at the edge comes out as it does in the neighbor. frames:
    those that can touch any of them, in order.
    """

    column: tuple[int, int]
    blocks: NDArray[np.int32]
    frames: tuple[int, ...]

    @property
    def name(self) -> str:
        """The tile's name in file names, such as ``+0-1``."""
        return f"{self.column[0]:+d}{self.column[1]:+d}"


@dataclass(frozen=True, eq=False)
class Tiling:
    """The tiles of a map, row by row, back and forth, so that neighbors share the frames just read.

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
    """The blocks of voxels that surfaces pass through, in square tiles of edge ``tile_m``."""
    block_m, reach_m = BLOCK * voxel_m, TRUNCATION_VOXELS * voxel_m
    tile_blocks = int(np.clip(round(tile_m / block_m), 1, OFFSET))
    boxes = _boxes(component, reach_m, block_m)
    if not boxes:
        return Tiling((), voxel_m, tile_blocks, 0)
    blocks = _unpack(_occupied_blocks(component, list(boxes), reach_m, block_m))
    columns = len(
        np.unique(packed(blocks[:, 0].astype(np.int64), blocks[:, 1].astype(np.int64), 0))
    )
    return Tiling(tuple(_deal(blocks, boxes, tile_blocks)), voxel_m, tile_blocks, columns)


Boxes = dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]
"""The lowest and the highest block (x, y, z) that each frame can touch, by the frame's number."""


def _boxes(component: Component, reach_m: float, block_m: float) -> Boxes:
    """The box of each frame that has points; it holds the camera, since rays carve the space before
    the surface.
    """
    boxes: Boxes = {}
    for i in component.frames.tolist():
        points = component.points_m(i)
        if len(points):
            points = np.concatenate([points, component.T_local_camera[i, None, :3, 3]])
            lowest = np.floor((points.min(axis=0) - reach_m) / block_m)
            highest = np.floor((points.max(axis=0) + reach_m) / block_m)
            boxes[i] = lowest, highest
    return boxes


def _occupied_blocks(
    component: Component, frames: list[int], reach_m: float, block_m: float
) -> NDArray[np.int64]:
    """Packed coordinates, sorted, of blocks within reach of the frames' certain points."""
    certain = component.survey.index.certain
    found: NDArray[np.int64] = np.zeros(0, np.int64)
    for start in range(0, len(frames), FRAMES_AT_ONCE):
        parts = [found]
        for i in frames[start : start + FRAMES_AT_ONCE]:
            points = component.points_m(i)
            parts.append(_blocks_near(points[certain[i]] if certain else points, reach_m, block_m))
        found = np.unique(np.concatenate(parts))
    return found


def _blocks_near(points: NDArray[np.float64], reach_m: float, block_m: float) -> NDArray[np.int64]:
    """Packed coordinates of blocks within reach of points (n, 3), at most two an axis."""
    low = np.floor((points - reach_m) / block_m).astype(np.int64)
    high = np.floor((points + reach_m) / block_m).astype(np.int64)
    lowest = packed(*low.T)
    # 0 or 1 step along an axis, as a difference of packed numbers
    x, y, z = (high - low).T << np.array([[2 * BITS], [BITS], [0]])
    return np.unique(
        np.concatenate([lowest + i * x + j * y + k * z for i, j, k in np.ndindex(2, 2, 2)])
    )


def _unpack(numbers: NDArray[np.int64]) -> NDArray[np.int32]:
    mask = (1 << BITS) - 1
    return (
        np.stack([numbers >> (2 * BITS), (numbers >> BITS) & mask, numbers & mask], axis=-1)
        - OFFSET
    ).astype(np.int32)


def _deal(blocks: NDArray[np.int32], boxes: Boxes, tile_blocks: int) -> Iterator[Tile]:
    """The tiles that hold any of the blocks (B, 3), row by row, back and forth."""
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
        yield Tile(
            (int(column[0]), int(column[1])), blocks[inside], tuple(numbers[touching].tolist())
        )
