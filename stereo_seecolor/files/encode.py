"""Encoding of arrays to file contents, with settings by measurement (docs/performance.md)."""

import struct
import zlib
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ImageCms

from stereo_seecolor.files.png import encode_codes, encode_png
from stereo_seecolor.files.tiff import encode_deflated, encode_tiff
from stereo_seecolor.records import Map, is_monochrome

ImageFormat = Literal["png", "png16", "tiff", "tiff32", "jpg"]
JPEG_QUALITY = 95  # no blocks are seen; above, files grow fast


def encode_image(rgb: NDArray[np.generic], image_format: ImageFormat, exif: bytes = b"") -> bytes:
    """Encode an RGB image (H, W, 3); it is written as one channel where red, green and blue are
    equal everywhere.

    png and tiff keep 8 or 16 bits; png16 scales 8 bits up to 16; jpg takes 8 bits (16 are scaled
    down); tiff32 takes float32.
    exif: a Capture's block. It is embedded, and in png and jpg the sRGB profile (of color images).
    """
    if image_format == "png16" and rgb.dtype == np.uint8:
        rgb = rgb.astype(np.uint16) * 257
    if image_format == "jpg" and rgb.dtype == np.uint16:
        rgb = (rgb // 257).astype(np.uint8)
    mono = is_monochrome(rgb)
    pixels = rgb[..., 0] if mono else rgb
    if image_format in ("tiff", "tiff32"):
        return encode_tiff(pixels, exif)
    if image_format == "jpg":
        return _encode_jpeg(
            pixels,
            {cv2.IMAGE_METADATA_EXIF: exif, cv2.IMAGE_METADATA_ICCP: b"" if mono else SRGB_PROFILE},
        )
    chunks = {} if mono else {b"iCCP": SRGB_CHUNK}
    return encode_png(pixels, {**chunks, b"eXIf": exif} if exif else chunks)


def encode_map(values: Map, compact: bool = False) -> bytes:
    """Encode a map (H, W) of float32 as TIFF; compact: deflated."""
    values = values.astype(np.float32, copy=False)
    return encode_deflated(values) if compact else encode_tiff(values)


def rounded(values: Map) -> Map:
    """Round (H, W) float32 to 9 significant bits, which deflate to 40 % of the size: standard
    errors are not known to 0.2 %.
    """
    bits = values.astype(np.float32).view(np.uint32)
    nearest = ((bits + np.uint32(1 << 14)) & np.uint32(0xFFFF8000)).view(np.float32)
    return np.where(np.isfinite(values), nearest, values).astype(np.float32)


def encode_confidence(confidence: Map) -> bytes:
    """Encode a confidence (H, W) in [0, 1] as an 8-bit PNG, 255 = 1; rounded up, so that 0 is kept
    for what was not measured.
    """
    return encode_codes(np.ceil(confidence * 255).astype(np.uint8))


def _srgb_profile() -> bytes:
    """The ICC profile of sRGB, with a fixed date of creation: equal images are equal files."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return profile[:24] + struct.pack(">6H", 2000, 1, 1, 0, 0, 0) + profile[36:]


SRGB_PROFILE = _srgb_profile()
# the profile's name, and that it is deflated
SRGB_CHUNK = b"sRGB\0\0" + zlib.compress(SRGB_PROFILE)
"""Content of a PNG's iCCP."""


def _encode_jpeg(pixels: NDArray[np.generic], metadata: dict[int, bytes]) -> bytes:
    metadata = {kind: block for kind, block in metadata.items() if block}
    blocks = [np.frombuffer(block, np.uint8) for block in metadata.values()]
    stored = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencodeWithMetadata(
        ".jpg", stored, list(metadata), blocks, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    return encoded.tobytes()
