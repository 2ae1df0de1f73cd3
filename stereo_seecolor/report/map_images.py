"""The orthomosaic for deep zoom, and the terrain as a shaded picture."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

TILE_PX = 512
FIRST_LEVEL = 8
"""At most 256 pixels: coarser levels are never looked at."""
WEBP_QUALITY = 80
TERRAIN_PX = 2400
"""Longer side of the terrain's picture: its cells are twice as large as those of the mosaic."""
LIGHT = np.array([-0.5, 0.5, 0.7071])
"""From the north-west, 45 degrees high, as relief is drawn on maps."""

Read = Callable[[tuple[int, int, int, int], tuple[int, int]], NDArray[Any]]


def pyramid(width: int, height: int, read: Read) -> Iterator[tuple[str, bytes]]:
    """(LEVEL/COLUMN_ROW.webp, content) of all tiles; each level is half as fine as the next, and level 0 would be a pixel.

    read: (left, top, width, height) of the image and a size (width, height) -> (h, w, 4) RGBA of that size.
    """
    finest = levels(width, height) - 1
    for level in range(min(FIRST_LEVEL, finest), finest + 1):
        scale = 1 << (finest - level)
        for row in range(-(-height // (TILE_PX * scale))):
            for column in range(-(-width // (TILE_PX * scale))):
                left, top = column * TILE_PX * scale, row * TILE_PX * scale
                across, down = min(TILE_PX * scale, width - left), min(TILE_PX * scale, height - top)
                size = -(-across // scale), -(-down // scale)
                yield f"{level}/{column}_{row}.webp", _webp(read((left, top, across, down), size))


def levels(width: int, height: int) -> int:
    """Number of levels of the pyramid, as deep zoom counts them."""
    return int(np.ceil(np.log2(max(width, height, 1)))) + 1


def mosaic_tiles(path: Path) -> tuple[dict[str, Any], Iterator[tuple[str, bytes]]] | None:
    """Size and place of orthomosaic.tif and its tiles; None where the library that reads it is missing."""
    try:
        import rasterio
    except ImportError:  # pragma: no cover: where the geo extra is missing
        return None
    with rasterio.open(path) as mosaic:
        about = _place(mosaic)

    def read(box: tuple[int, int, int, int], size: tuple[int, int]) -> NDArray[Any]:
        with rasterio.open(path) as mosaic:
            window = rasterio.windows.Window(*box)
            return np.moveaxis(mosaic.read(window=window, out_shape=(4, size[1], size[0])), 0, -1)

    return about, pyramid(about["width"], about["height"], read)


def shaded_terrain(path: Path) -> tuple[dict[str, Any], bytes] | None:
    """Place and picture of dem.tif: heights in colors, lit from the north-west; None where it cannot be read."""
    try:
        import rasterio
    except ImportError:  # pragma: no cover: where the geo extra is missing
        return None
    with rasterio.open(path) as terrain:
        scale = max(1.0, max(terrain.width, terrain.height) / TERRAIN_PX)
        size = max(1, int(terrain.height / scale)), max(1, int(terrain.width / scale))
        heights = terrain.read(1, out_shape=size, masked=True).filled(np.nan).astype(np.float64)
        cell_m = float(terrain.transform.a) * terrain.width / size[1]
        about = {**_place(terrain), "low_m": _percentile(heights, 1), "high_m": _percentile(heights, 99)}
    return about, _webp(_shaded(heights, cell_m, about["low_m"], about["high_m"]))


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


def _shaded(heights: NDArray[np.float64], cell_m: float, low_m: float, high_m: float) -> NDArray[np.uint8]:
    """(h, w, 4) RGBA, clear where the height is unknown."""
    filled = np.where(np.isfinite(heights), heights, low_m)
    down, right = np.gradient(filled, cell_m)
    normal = np.stack([-right, down, np.ones_like(filled)], axis=-1)
    light = np.clip((normal / np.linalg.norm(normal, axis=-1, keepdims=True)) @ LIGHT, 0, 1)
    level = np.clip((filled - low_m) / max(high_m - low_m, 1e-9) * 255, 0, 255).astype(np.uint8)
    color = cv2.applyColorMap(level, cv2.COLORMAP_CIVIDIS)[..., ::-1].astype(np.float64)
    rgb = np.clip(color * (0.35 + 0.9 * light[..., None]), 0, 255).astype(np.uint8)
    return np.dstack([rgb, np.where(np.isfinite(heights), 255, 0).astype(np.uint8)])


def _webp(rgba: NDArray[Any]) -> bytes:
    bgra = cv2.cvtColor(np.ascontiguousarray(rgba, dtype=np.uint8), cv2.COLOR_RGBA2BGRA)
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])
    return encoded.tobytes()
