"""Gaps of a map for the page: hatched from above, and why each cell has no height."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.files.rasters import open_raster
from stereo_seecolor.report.map_images import Box, pyramid

STRIPE_PX, PERIOD_PX = 3, 8
"""Of a hatch, along a row, at every level of detail."""
STRIPE, BETWEEN = (60, 60, 60, 255), (190, 190, 190, 255)
"""RGBA: seen before the colors of a reef, and on light and dark pages."""


def fits(path: Path, about: dict[str, Any]) -> bool:
    """Whether a raster of reasons has the size of the terrain. Raises InputError."""
    with open_raster(path) as file:
        return (file.width, file.height) == (about["width"], about["height"])


def gap_tiles(path: Path, width: int, height: int) -> Iterator[tuple[str, bytes]]:
    """Tiles of a raster of reasons, hatched where there is one, clear elsewhere."""

    def read(box: Box, size: tuple[int, int]) -> NDArray[Any]:
        step = max(1, round(box[2] / size[0]))
        return hatch(reasons(path, box, size), (box[0] // step, box[1] // step))

    return pyramid(width, height, read)


def reasons(path: Path, box: Box, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(h, w) codes of a box (left, top, width, height) at a size. Raises InputError."""
    import rasterio

    with open_raster(path) as file:
        shape = None if size is None else (size[1], size[0])
        window = rasterio.windows.Window(*box)
        return np.asarray(
            file.read(1, window=window, out_shape=shape, resampling=rasterio.enums.Resampling.mode),
            np.uint8,
        )


def hatch(codes: NDArray[np.uint8], corner_px: tuple[int, int]) -> NDArray[np.uint8]:
    """(h, w, 4) RGBA of codes (h, w) of which the first lies at a place (x, y): stripes that run on
    from tile to tile.
    """
    y, x = np.indices(codes.shape)
    stripe = np.asarray((x + y + sum(corner_px)) % PERIOD_PX < STRIPE_PX)
    colors = np.where(stripe[..., None], STRIPE, BETWEEN)
    return np.where((codes > 0)[..., None], colors, 0).astype(np.uint8)


def packed_reasons(codes: NDArray[np.uint8]) -> dict[str, bytes]:
    """What a tile of heights gets beside them; nothing where it has no gap."""
    return {"gaps": deflated(codes.tobytes(), repeats=True)} if codes.any() else {}
