"""A raster on disk of which only the blocks that hold something exist: the bounding box of a long
track is mostly empty.
"""

from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.atomic import output_errors
from stereo_seecolor.files.raw_arrays import load_array
from stereo_seecolor.mapping.raster.grid import Grid

BLOCK_PX = 512
"""1 MB of heights: few files, and little that is empty along a track."""


class BlockRaster:
    """A raster (bands, H, W) in blocks of 512 x 512 cells, each a file of ``folder``; cells never
    written are ``fill``.
    """

    def __init__(
        self, folder: Path, grid: Grid, bands: int, dtype: type[np.generic], fill: float
    ) -> None:
        self.grid, self.bands, self.dtype, self.fill = grid, bands, dtype, fill
        self._folder = folder
        self._blocks: set[tuple[int, int]] = set()

    def read(self, rows: slice, columns: slice) -> NDArray[Any]:
        """Read a window (bands, h, w), which may reach beyond the raster."""
        result = np.full(
            (self.bands, rows.stop - rows.start, columns.stop - columns.start),
            self.fill,
            self.dtype,
        )
        for block, here, there in self._overlaps(rows, columns):
            if block in self._blocks:
                result[:, here[0], here[1]] = load_array(self._path(block))[:, there[0], there[1]]
        return result

    def write(self, rows: slice, columns: slice, values: NDArray[Any]) -> None:
        """Replace a window by (bands, h, w). Raises OutputError if the disk is full."""
        for block, here, there in self._overlaps(rows, columns):
            if block in self._blocks:
                content = load_array(self._path(block))
            else:
                content = np.full((self.bands, BLOCK_PX, BLOCK_PX), self.fill, self.dtype)
            content[:, there[0], there[1]] = values[:, here[0], here[1]]
            with output_errors(self._path(block)):
                self._folder.mkdir(parents=True, exist_ok=True)
                np.save(self._path(block), content)
            self._blocks.add(block)

    def windows(self) -> Iterator[tuple[slice, slice]]:
        """Iterate over the windows of all blocks that exist, clipped to the raster, row by row."""
        return block_windows(self._blocks, self.grid.shape)

    def _overlaps(
        self, rows: slice, columns: slice
    ) -> Iterator[tuple[tuple[int, int], tuple[slice, slice], tuple[slice, slice]]]:
        """Each block that a window meets: its number, the parts of the window and of the block."""
        spans = (
            range(max(side.start, 0) // BLOCK_PX, -(-min(side.stop, length) // BLOCK_PX))
            for side, length in zip((rows, columns), self.grid.shape, strict=True)
        )
        for row, column in product(*spans):
            parts = [_overlap(rows, row), _overlap(columns, column)]
            yield (row, column), (parts[0][0], parts[1][0]), (parts[0][1], parts[1][1])

    def _path(self, block: tuple[int, int]) -> Path:
        return self._folder / f"{block[0]}-{block[1]}.npy"


def block_windows(
    blocks: Iterable[tuple[int, int]], shape: tuple[int, int]
) -> Iterator[tuple[slice, slice]]:
    """The windows of blocks of a raster, clipped to it, row by row; without those beyond it."""
    for row, column in sorted(blocks):
        top, left = row * BLOCK_PX, column * BLOCK_PX
        if top < shape[0] and left < shape[1]:
            bottom, right = min(top + BLOCK_PX, shape[0]), min(left + BLOCK_PX, shape[1])
            yield slice(top, bottom), slice(left, right)


def _overlap(window: slice, block: int) -> tuple[slice, slice]:
    first, last = max(window.start, block * BLOCK_PX), min(window.stop, (block + 1) * BLOCK_PX)
    return slice(first - window.start, last - window.start), slice(
        first - block * BLOCK_PX, last - block * BLOCK_PX
    )
