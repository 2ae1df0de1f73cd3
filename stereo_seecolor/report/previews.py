"""Images of any output format as JPEG that every browser shows."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.decode import eight_bit


@dataclass(frozen=True)
class PreviewSizes:
    """Longer sides in pixels, and JPEG qualities."""

    thumbnail_px: int = 192  # 96 CSS pixels wide on a screen of double density
    thumbnail_quality: int = 72  # about 4 kB: 5,000 of them are 20 MB
    image_px: int = 1600  # as wide as the viewer on a large screen; the full image is a click away
    image_quality: int = 85  # no blocks to be seen at this size
    live_px: int = 480  # three beside each other on a laptop; about 30 kB


SIZES = PreviewSizes()


def thumbnail(pixels: NDArray[Any]) -> bytes:
    """A JPEG of an image (H, W) or (H, W, 3) RGB; uint8, uint16, or float32 linear light."""
    return _jpeg(_smaller(pixels, SIZES.thumbnail_px), SIZES.thumbnail_quality)


def preview(pixels: NDArray[Any]) -> bytes:
    """A JPEG as large as a screen; arguments as of ``thumbnail``."""
    return _jpeg(_smaller(pixels, SIZES.image_px), SIZES.image_quality)


def live_picture(pixels: NDArray[Any]) -> bytes:
    """A JPEG for the page of a run under way; arguments as of ``thumbnail``."""
    return _jpeg(_smaller(pixels, SIZES.live_px), SIZES.thumbnail_quality)


def _smaller(pixels: NDArray[Any], longer_px: int) -> NDArray[Any]:
    height, width = pixels.shape[:2]
    scale = longer_px / max(height, width)
    if scale >= 1:
        return pixels
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))


def _jpeg(pixels: NDArray[Any], quality: int) -> bytes:
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(eight_bit(pixels), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    return encoded.tobytes()
