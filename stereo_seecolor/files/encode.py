"""Arrays to file contents. The settings were chosen by measurement: see docs/performance.md."""

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Map

ImageFormat = Literal["png", "png16", "tiff32", "jpg"]
SUFFIX: dict[ImageFormat, str] = {"png": ".png", "png16": ".png", "tiff32": ".tiff", "jpg": ".jpg"}
PNG = [
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
]
JPEG_QUALITY = 95
TIFF_UNCOMPRESSED = 1


def encode_image(rgb: NDArray[np.generic], image_format: ImageFormat) -> bytes:
    """(H, W, 3) RGB to a file's content.

    png keeps 8 or 16 bits; png16 scales 8 bits up to 16; jpg takes 8 bits (16 are scaled down); tiff32 takes float32.
    """
    if image_format == "png16" and rgb.dtype == np.uint8:
        rgb = rgb.astype(np.uint16) * 257
    if image_format == "jpg" and rgb.dtype == np.uint16:
        rgb = (rgb // 257).astype(np.uint8)
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    if image_format == "tiff32":
        return _encode(".tiff", bgr, [cv2.IMWRITE_TIFF_COMPRESSION, TIFF_UNCOMPRESSED])
    if image_format == "jpg":
        return _encode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return _encode(".png", bgr, PNG)


def encode_map(values: Map) -> bytes:
    """(H, W) float32, NaN unknown, to the content of a one-page float32 TIFF."""
    return _encode(".tiff", values.astype(np.float32, copy=False), [cv2.IMWRITE_TIFF_COMPRESSION, TIFF_UNCOMPRESSED])


def encode_confidence(confidence: Map) -> bytes:
    """(H, W) in [0, 1] to an 8-bit PNG, 255 = 1; rounded up, so that 0 is kept for what was not measured."""
    return _encode(".png", np.ceil(confidence * 255).astype(np.uint8), PNG)


def encode_mask(mask: NDArray[np.uint8]) -> bytes:
    """(H, W) uint8 codes to a PNG."""
    return _encode(".png", mask, PNG)


def _encode(suffix: str, pixels: NDArray[np.generic], parameters: list[int]) -> bytes:
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(suffix, pixels, parameters)
    return encoded.tobytes()
