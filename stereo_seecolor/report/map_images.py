"""The orthomosaic and the terrain for deep zoom: tiles of all levels, the terrain in colors and as
light and shade alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.files.rasters import can_read_rasters, open_raster
from stereo_seecolor.mapping.raster.grid import Grid

TILE_PX = 512
FIRST_LEVEL = 8
"""At most 256 pixels: coarser levels are never viewed."""
WEBP_QUALITY = 75
SAMPLE_PX = 2400
"""Longer side, pixels, of the reduced terrain whose lowest and highest heights are found."""
LIGHT = np.array([-0.5, 0.5, 0.7071])
"""Direction of the light: from the north-west, 45 degrees high, as relief is drawn on maps."""

Box = tuple[int, int, int, int]
"""Left, top, width, height in pixels."""
Read = Callable[[Box, tuple[int, int]], NDArray[Any]]


def pyramid(width: int, height: int, read: Read) -> Iterator[tuple[str, bytes]]:
    """(LEVEL/COLUMN_ROW.webp, content) of all tiles, made on all cores; each level is half as fine
    as the next, and level 0 would be a pixel.

    read: (left, top, width, height) of the image and a size (width, height) -> (h, w, 4) RGBA of
    that size; from any thread.
    """

    def tile(place: tuple[int, int, int]) -> tuple[str, bytes]:
        level, row, column = place
        scale = 1 << (finest - level)
        left, top = column * TILE_PX * scale, row * TILE_PX * scale
        across, down = min(TILE_PX * scale, width - left), min(TILE_PX * scale, height - top)
        size = -(-across // scale), -(-down // scale)
        return f"{level}/{column}_{row}.webp", _webp(read((left, top, across, down), size))

    finest = levels(width, height) - 1
    places = (
        (level, row, column)
        for level in range(min(FIRST_LEVEL, finest), finest + 1)
        for row in range(-(-height // (TILE_PX << (finest - level))))
        for column in range(-(-width // (TILE_PX << (finest - level))))
    )
    return Threads(cores()).each(tile, places)


def levels(width: int, height: int) -> int:
    """Number of levels of the pyramid, as deep zoom counts them."""
    return int(np.ceil(np.log2(max(width, height, 1)))) + 1


def mosaic_tiles(path: Path) -> tuple[dict[str, Any], Iterator[tuple[str, bytes]]]:
    """Size and place of orthomosaic.tif and its tiles."""
    import rasterio

    with open_raster(path, 4) as mosaic:
        about = _place(mosaic)

    def read(box: Box, size: tuple[int, int]) -> NDArray[Any]:
        with open_raster(path, 4) as mosaic:
            window = rasterio.windows.Window(*box)
            return np.moveaxis(
                mosaic.read([1, 2, 3, 4], window=window, out_shape=(4, size[1], size[0])), 0, -1
            )

    return about, pyramid(about["width"], about["height"], read)


@dataclass(frozen=True)
class TerrainImages:
    """dem.tif for the page. about: its size, place, and heights of its colors (low_m, high_m).
    base_m: the height of its zero, which the file of a map deep in the sea states apart.
    """

    path: Path
    about: dict[str, Any]
    base_m: float = 0.0

    @classmethod
    def open(cls, path: Path) -> "TerrainImages | None":
        """None where the library that reads it is missing."""
        if not can_read_rasters():  # pragma: no cover: where the geo extra is missing
            return None
        with open_raster(path) as file:
            scale = max(1.0, max(file.width, file.height) / SAMPLE_PX)
            size = max(1, int(file.height / scale)), max(1, int(file.width / scale))
            heights = file.read(1, out_shape=size, masked=True).filled(np.nan).astype(np.float64)
            limits = {"low_m": _percentile(heights, 1), "high_m": _percentile(heights, 99)}
            return cls(path, {**_place(file), **limits}, float(file.offsets[0]))

    @property
    def grid(self) -> Grid:
        """Its cells, in the coordinates of the file."""
        at = self.about
        return Grid(at["west_m"], at["north_m"], at["pixel_m"], (at["height"], at["width"]))

    def heights_m(self, box: Box, size: tuple[int, int] | None = None) -> NDArray[np.float32]:
        """(h, w) of a box (left, top, width, height) at a size (width, height), NaN if unknown."""
        import rasterio

        with open_raster(self.path) as file:
            shape = None if size is None else (size[1], size[0])
            window = rasterio.windows.Window(*box)
            part = file.read(1, window=window, out_shape=shape, masked=True)
        return np.asarray(part.filled(np.nan), np.float32)

    def tiles(self, colored: bool) -> Iterator[tuple[str, bytes]]:
        """Tiles of heights in colors, lit from the north-west; or of light and shade alone, to be
        laid over the mosaic.
        """
        shaded = partial(self._shaded, colored)
        return pyramid(self.about["width"], self.about["height"], shaded)

    def _shaded(self, colored: bool, box: Box, size: tuple[int, int]) -> NDArray[np.uint8]:
        """(h, w, 4) RGBA, clear where the height is unknown; neighbors beyond the box are used, so
        that no seam is seen.
        """
        step = max(1, round(box[2] / size[0]))
        left, top = int(box[0] > 0), int(box[1] > 0)
        right = int(box[0] + box[2] < self.about["width"])
        bottom = int(box[1] + box[3] < self.about["height"])
        wider = (
            box[0] - left * step,
            box[1] - top * step,
            box[2] + (left + right) * step,
            box[3] + (top + bottom) * step,
        )
        heights = self.heights_m(wider, (size[0] + left + right, size[1] + top + bottom)).astype(
            np.float64
        )
        inner = np.s_[top : top + size[1], left : left + size[0]]
        light, heights = _light(heights, self.about["pixel_m"] * step)[inner], heights[inner]
        known = np.isfinite(heights)
        alpha = np.where(known, 255, 0).astype(np.uint8)
        if not colored:
            # level ground is white: it darkens nothing
            gray = np.clip(255 * light / LIGHT[2], 0, 255).astype(np.uint8)
            return np.dstack([gray, gray, gray, alpha])
        low_m, high_m = self.about["low_m"], self.about["high_m"]
        level = np.clip(
            (np.where(known, heights, low_m) - low_m) / max(high_m - low_m, 1e-9) * 255, 0, 255
        ).astype(np.uint8)
        color = cv2.applyColorMap(level, cv2.COLORMAP_CIVIDIS)[..., ::-1].astype(np.float64)
        return np.dstack(
            [np.clip(color * (0.35 + 0.9 * light[..., None]), 0, 255).astype(np.uint8), alpha]
        )


def _place(image: Any) -> dict[str, Any]:
    """Size, and where the upper left corner lies."""
    transform = image.transform
    return {
        "width": image.width,
        "height": image.height,
        "west_m": float(transform.c),
        "north_m": float(transform.f),
        "pixel_m": float(transform.a),
    }


def _percentile(values: NDArray[np.float64], percent: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.percentile(known, percent)) if known.size else 0.0


def _light(heights: NDArray[np.float64], cell_m: float) -> NDArray[np.float64]:
    """(h, w) of 0 to 1: how much light falls on each cell; level beside unknown ones."""
    if min(heights.shape) < 2:
        return np.full(heights.shape, LIGHT[2])
    down, right = np.gradient(heights, cell_m)
    normal = np.stack([-np.nan_to_num(right), np.nan_to_num(down), np.ones_like(heights)], axis=-1)
    light: NDArray[np.float64] = np.clip(
        (normal / np.linalg.norm(normal, axis=-1, keepdims=True)) @ LIGHT, 0, 1
    )
    return light


def _webp(rgba: NDArray[Any]) -> bytes:
    bgra = cv2.cvtColor(np.ascontiguousarray(rgba, dtype=np.uint8), cv2.COLOR_RGBA2BGRA)
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])
    return encoded.tobytes()
