"""The bands of disparities to search: for each tile, around those of a coarse match."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Map

LANES, PIXELS, TILE = 16, 4, 8
"""TILE: edge of a tile, pixels; all pixels of a tile search the same disparities."""
BLOCK = LANES * PIXELS
FAR = 0xFF
"""Cost of disparities outside a band; sums with it saturate at it."""
P1_SHIFT = 2
"""P1 is P2 >> P1_SHIFT, a quarter of it: a low P2, at image edges, also means a low P1."""
WINDOW = 2 * LANES
"""Pixels of the right image that a tile's row is compared with for LANES disparities."""


MARGIN_PX = 4
"""Margin of a band around coarse disparities: a coarse pixel, in pixels of the full image."""
WIDENING = LANES
"""Disparities by which a band that proved too narrow is widened, on both sides."""


@dataclass(frozen=True, eq=False)
class Band:
    """The band of each tile: tile t searches lowest[t] .. lowest[t] + count[t] - 1; both (rows of
    tiles, columns of tiles) int32.
    """

    lowest: NDArray[np.int32]
    count: NDArray[np.int32]

    @classmethod
    def everywhere(cls, shape: tuple[int, int], lowest: int, highest: int) -> "Band":
        """Give all tiles of an image of that shape the same band."""
        tiles = (-(-shape[0] // TILE), -(-shape[1] // TILE))
        return cls(
            np.full(tiles, lowest, np.int32),
            np.full(tiles, _whole_lanes(highest - lowest + 1), np.int32),
        )

    @classmethod
    def around(
        cls, coarse: Map, scale: int, shape: tuple[int, int], lowest: int, highest: int
    ) -> "Band":
        """Compute the bands of an image of that shape from disparities at 1 / scale of its size,
        NaN where none was found.

        A tile includes the disparities of its neighbors, so that both sides of an edge are searched
        along it; a tile without disparities gets those of the nearest tile that has some.
        """
        tiles = (-(-shape[0] // TILE), -(-shape[1] // TILE))
        low, high = _extremes(coarse, tiles, TILE // scale)
        low, high = _grow(low, high, 1)
        for reach in (2, 4, 8, 16):
            wide_low, wide_high = _grow(low, high, reach)
            low = np.where(np.isfinite(low), low, wide_low)
            high = np.where(np.isfinite(high), high, wide_high)
        low = np.where(np.isfinite(low), low * scale - MARGIN_PX, lowest)
        high = np.where(np.isfinite(high), high * scale + MARGIN_PX, highest)
        first = (np.clip(low, lowest, highest) // 4 * 4).astype(np.int32)
        count = _whole_lanes(np.ceil(np.clip(high, lowest, highest)) - first + 1)
        return cls(first, count)

    def widened(self, tiles: NDArray[np.bool_]) -> "Band":
        """Widen the bands of these tiles by WIDENING on both sides."""
        return Band(
            np.where(tiles, self.lowest - WIDENING, self.lowest).astype(np.int32),
            np.where(tiles, self.count + 2 * WIDENING, self.count).astype(np.int32),
        )


def _whole_lanes(count: Any) -> NDArray[np.int32]:
    lanes: NDArray[np.int32] = (np.ceil(np.maximum(count, 1) / LANES) * LANES).astype(np.int32)
    return lanes


def _extremes(coarse: Map, tiles: tuple[int, int], side: int) -> tuple[Map, Map]:
    """Least and largest disparity of each tile of side x side coarse pixels; +-inf for none."""
    padded = np.full((tiles[0] * side, tiles[1] * side), np.nan, np.float32)
    padded[: coarse.shape[0], : coarse.shape[1]] = coarse
    of_tiles = [padded[row::side, column::side] for row in range(side) for column in range(side)]
    low, high = np.fmin.reduce(of_tiles), np.fmax.reduce(of_tiles)
    return np.where(np.isnan(low), np.inf, low), np.where(np.isnan(high), -np.inf, high)


def _grow(low: Map, high: Map, reach: int) -> tuple[Map, Map]:
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return cv2.erode(low, square, borderValue=np.inf), cv2.dilate(high, square, borderValue=-np.inf)
