"""Arrays to file contents. The settings were chosen by measurement: see docs/performance.md."""

import struct
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ImageCms

from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.records import Map, is_monochrome

ImageFormat = Literal["png", "png16", "tiff", "tiff32", "jpg"]
PNG = [
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
]
JPEG_QUALITY = 95
TIFF_UNCOMPRESSED = 1


def encode_image(rgb: NDArray[np.generic], image_format: ImageFormat, exif: bytes = b"") -> bytes:
    """(H, W, 3) RGB to a file's content; written as one channel where red, green and blue are equal everywhere.

    png and tiff keep 8 or 16 bits; png16 scales 8 bits up to 16; jpg takes 8 bits (16 are scaled down); tiff32 takes float32.
    exif: a Capture's block. It is embedded, and in png and jpg the sRGB profile (of color images).
    """
    if image_format == "png16" and rgb.dtype == np.uint8:
        rgb = rgb.astype(np.uint16) * 257
    if image_format == "jpg" and rgb.dtype == np.uint16:
        rgb = (rgb // 257).astype(np.uint8)
    mono = is_monochrome(rgb)
    pixels = rgb[..., 0] if mono else cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    if image_format in ("tiff", "tiff32"):
        return encode_tiff(rgb[..., 0] if mono else rgb, exif)
    metadata = {cv2.IMAGE_METADATA_EXIF: exif, cv2.IMAGE_METADATA_ICCP: b"" if mono else SRGB_PROFILE}
    suffix, parameters = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]) if image_format == "jpg" else (".png", PNG)
    return _encode_with_metadata(suffix, pixels, {kind: block for kind, block in metadata.items() if block}, parameters)


def encode_map(values: Map) -> bytes:
    """(H, W) float32, NaN unknown, to the content of a one-page float32 TIFF."""
    return _encode(".tiff", values.astype(np.float32, copy=False), [cv2.IMWRITE_TIFF_COMPRESSION, TIFF_UNCOMPRESSED])


def encode_depth_mm(depth_m: Map) -> bytes:
    """(H, W) meters, NaN unknown, to a 16-bit PNG in millimeters, 0 where unknown or beyond 65.535 m."""
    depth_mm = np.round(1000 * np.nan_to_num(depth_m))
    return _encode(".png", np.where(depth_mm <= np.iinfo(np.uint16).max, depth_mm, 0).astype(np.uint16), PNG)


def encode_confidence(confidence: Map) -> bytes:
    """(H, W) in [0, 1] to an 8-bit PNG, 255 = 1; rounded up, so that 0 is kept for what was not measured."""
    return _encode(".png", np.ceil(confidence * 255).astype(np.uint8), PNG)


def encode_mask(mask: NDArray[np.uint8]) -> bytes:
    """(H, W) uint8 codes to a PNG."""
    return _encode(".png", mask, PNG)


def _srgb_profile() -> bytes:
    """The ICC profile of sRGB, with a date of creation that never changes, so that equal images are equal files."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return profile[:24] + struct.pack(">6H", 2000, 1, 1, 0, 0, 0) + profile[36:]


SRGB_PROFILE = _srgb_profile()


def _encode_with_metadata(suffix: str, pixels: NDArray[np.generic], metadata: dict[int, bytes], parameters: list[int]) -> bytes:
    blocks = [np.frombuffer(block, np.uint8) for block in metadata.values()]
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencodeWithMetadata(suffix, pixels, list(metadata), blocks, parameters)
    return encoded.tobytes()


def _encode(suffix: str, pixels: NDArray[np.generic], parameters: list[int]) -> bytes:
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencode(suffix, pixels, parameters)
    return encoded.tobytes()
