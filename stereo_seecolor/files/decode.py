"""Reading of the program's own image files as arrays; what their headers claim is checked first."""

import struct
import sys
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.deflate import inflated
from stereo_seecolor.files.image_headers import (
    PNG_SIGNATURE,
    TIFF_COMPRESSION,
    TIFF_SIGNATURES,
    image_size,
    refuse_large,
    stated_size,
    tiff_numbers,
)
from stereo_seecolor.files.png_decoding import quickly_decoded
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.files.tiff import BLACK_IS_ZERO, DEFLATED, FLOAT, FLOATING_POINT, UNCOMPRESSED
from stereo_seecolor.files.whole_files import read_bytes

PREDICTOR, STRIP, STRIP_BYTES = 317, 273, 279
FLOAT_GRAY = {258: 32, 262: BLACK_IS_ZERO, 277: 1, 339: FLOAT}
"""Tag -> value: bits, what 0 means, values a pixel, and their kind."""
JPEG_END = b"\xff\xd9"
MOST_PER_BYTE = 10_000
"""Pixels; deflate makes a byte of 1032 at the most, each of 8 pixels."""
FEW_FILES = 16
"""So many OpenCV decodes while numba is imported, a quarter of a second; more are decoded in half
the time by our own kernels.
"""
_read = count(1)


def read_array(path: Path, size: tuple[int, int] | None = None) -> NDArray[Any]:
    """The pixels of a PNG, TIFF or JPEG as they are stored: (H, W), or (H, W, 3) RGB.

    size: (width, height) that it has to have. The header is asked before a pixel is decoded: a
    small file may claim, and hold, gigabytes.
    Raises InputError if the file is gone, cut short or damaged, of another size, or of more than
    MAX_PIXELS.
    """
    content = read_bytes(path)
    stored = stated_size(content)
    if size is not None and stored != size:
        raise InputError(
            f"{path}: is damaged: {' x '.join(map(str, stored)) or 'no'} pixels, and not "
            f"{size[0]} x {size[1]}"
        )
    if stored:
        refuse_large(path, *stored)
    # OpenCV fills the rest with gray
    if path.suffix.lower() in (".jpg", ".jpeg") and not content.endswith(JPEG_END):
        raise InputError(f"{path}: is truncated")
    if ("numba" in sys.modules or next(_read) > FEW_FILES) and (
        quick := quickly_decoded(content)
    ) is not None:
        return quick
    pixels: NDArray[Any] | None = None
    if content and _is_whole(content):
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise InputError(f"{path}: is damaged")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)) if pixels.ndim == 3 else pixels


def _strip(content: bytes, tags: dict[int, int]) -> memoryview:
    return memoryview(content)[tags[STRIP] : tags[STRIP] + tags[STRIP_BYTES]]


def _is_whole(content: bytes) -> bool:
    """False for a PNG or a TIFF of the program's own with a damaged byte, or with more pixels
    than its bytes can hold: OpenCV decodes it to a picture that is partly black.
    """
    if not content.startswith((PNG_SIGNATURE, *TIFF_SIGNATURES)):
        return True
    try:
        width, height = image_size(content)
        if width * height >= MOST_PER_BYTE * len(content):
            return False
        tags = tiff_numbers(content) if content.startswith(TIFF_SIGNATURES) else {}
        if any(tags.get(tag) != value for tag, value in FLOAT_GRAY.items()):
            return True
        if tags[TIFF_COMPRESSION] == UNCOMPRESSED:
            return len(_strip(content, tags)) == 4 * width * height
        if tags[TIFF_COMPRESSION] == DEFLATED and tags.get(PREDICTOR) == FLOATING_POINT:
            inflated(_strip(content, tags), 4 * width * height)
        return True
    except (ValueError, KeyError, struct.error):
        return False


def eight_bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """A corrected image of any format, gray for monochrome cameras, as (H, W, 3) 8-bit sRGB."""
    if image.dtype == np.uint16:
        image = image >> 8
    elif image.dtype == np.float32:
        image = np.rint(255 * encode_srgb(np.clip(image, 0, 1)))
    image = image.astype(np.uint8)
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
