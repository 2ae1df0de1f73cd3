"""Reading of the program's own image files as arrays; what their headers claim is checked first."""

import struct
import sys
import zlib
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.deflate import inflated
from stereo_seecolor.files.image_marks import PNG_SIGNATURE
from stereo_seecolor.files.png_decoding import png_chunks, quickly_decoded
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.files.tiff import BLACK_IS_ZERO, DEFLATED, FLOAT, FLOATING_POINT, UNCOMPRESSED
from stereo_seecolor.files.whole_files import read_bytes

COMPRESSION, PREDICTOR, WIDTH, HEIGHT, STRIP, STRIP_BYTES = 259, 317, 256, 257, 273, 279
FLOAT_GRAY = {258: 32, 262: BLACK_IS_ZERO, 277: 1, 339: FLOAT}
"""Tag -> value: bits, what 0 means, values a pixel, and their kind."""
SHORT = 3
JPEG_END = b"\xff\xd9"
MOST_PER_BYTE = 10_000
"""Pixels; deflate makes a byte of 1032 at the most, each of 8 pixels."""
MOST_PIXELS = 1 << 28
"""Of an image of ours: no camera has as many."""
JPEG_FRAMES = {*range(0xFFC0, 0xFFD0)} - {0xFFC4, 0xFFC8, 0xFFCC}
"""Markers before the size of a JPEG (ITU T.81, table B.1)."""
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
    MOST_PIXELS.
    """
    content = read_bytes(path)
    stored = _stored_size(content)
    if size is not None and stored != size:
        raise InputError(
            f"{path}: is damaged: {' x '.join(map(str, stored)) or 'no'} pixels, and not "
            f"{size[0]} x {size[1]}"
        )
    if stored and stored[0] * stored[1] > MOST_PIXELS:
        raise InputError(f"{path}: is damaged: it claims {stored[0]} x {stored[1]} pixels")
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


def _stored_size(content: bytes) -> tuple[int, int] | tuple[()]:
    """(width, height) by the header of a PNG, TIFF or JPEG; () where it says none."""
    try:
        if content.startswith(PNG_SIGNATURE):
            width, height = struct.unpack_from(">2I", content, 16)
            return width, height
        if content.startswith(b"II*\0"):
            tags = _tiff_tags(content)
            return tags[WIDTH], tags[HEIGHT]
        at = 2
        while content.startswith(b"\xff\xd8"):
            marker, length = struct.unpack_from(">HH", content, at)
            if marker in JPEG_FRAMES:
                height, width = struct.unpack_from(">HH", content, at + 5)
                return width, height
            at += 2 + length
    except (KeyError, struct.error):
        pass
    return ()


def _tiff_tags(content: bytes) -> dict[int, int]:
    """Those that hold one number."""
    (at,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, at)
    entries = (struct.unpack_from("<HHII", content, at + 2 + 12 * i) for i in range(count))
    return {
        tag: value & 0xFFFF if kind == SHORT else value
        for tag, kind, length, value in entries
        if length == 1
    }


def _strip(content: bytes, tags: dict[int, int]) -> memoryview:
    return memoryview(content)[tags[STRIP] : tags[STRIP] + tags[STRIP_BYTES]]


def _is_whole(content: bytes) -> bool:
    """False for a PNG or a TIFF of the program's own with a damaged byte, or with more pixels
    than its bytes can hold: OpenCV decodes it to a picture that is partly black.
    """
    try:
        if content.startswith(PNG_SIGNATURE):
            chunks = list(png_chunks(content))
            sums = (struct.unpack_from(">I", content, end)[0] for _, _, end in chunks)
            if any(
                zlib.crc32(content[start - 4 : end]) != total
                for (_, start, end), total in zip(chunks, sums, strict=True)
            ):
                return False
            width, height = struct.unpack_from(">2I", content, 16)
            return chunks[-1][0] == b"IEND" and width * height < MOST_PER_BYTE * len(content)
        if not content.startswith(b"II*\0"):
            return True
        tags = _tiff_tags(content)
        height, width = tags[HEIGHT], tags[WIDTH]
        if width * height >= MOST_PER_BYTE * len(content):
            return False
        if any(tags.get(tag) != value for tag, value in FLOAT_GRAY.items()):
            return True
        if tags[COMPRESSION] == UNCOMPRESSED:
            return len(_strip(content, tags)) == 4 * width * height
        if tags[COMPRESSION] == DEFLATED and tags.get(PREDICTOR) == FLOATING_POINT:
            inflated(_strip(content, tags), 4 * width * height)
        return True
    except (ValueError, KeyError, struct.error):
        return False


def eight_bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """A corrected image of any output format, one channel for monochrome cameras, as (H, W, 3)
    8-bit sRGB.
    """
    if image.dtype == np.uint16:
        image = image >> 8
    elif image.dtype == np.float32:
        image = np.rint(255 * encode_srgb(np.clip(image, 0, 1)))
    image = image.astype(np.uint8)
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
