"""Decoding of the program's own image files to arrays."""

import sys
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.quick_decode import quickly_decoded
from stereo_seecolor.files.srgb import encode_srgb

JPEG_END = b"\xff\xd9"
FEW_FILES = 16
"""So many OpenCV decodes while numba is imported, a quarter of a second; more are decoded in half the time by our own kernels."""
_read = count(1)


def read_array(path: Path) -> NDArray[Any]:
    """The pixels of a PNG, TIFF or JPEG as they are stored: (H, W), or (H, W, 3) RGB.

    Raises InputError if the file is gone, cut short or damaged.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if path.suffix.lower() in (".jpg", ".jpeg") and not content.endswith(JPEG_END):  # OpenCV fills the rest with gray
        raise InputError(f"{path}: is cut short")
    if ("numba" in sys.modules or next(_read) > FEW_FILES) and (quick := quickly_decoded(content)) is not None:
        return quick
    pixels: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) if content else None
    if pixels is None:
        raise InputError(f"{path}: is damaged")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)) if pixels.ndim == 3 else pixels


def eight_bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """A corrected image of any output format, one channel for monochrome cameras, as (H, W, 3) 8-bit sRGB."""
    if image.dtype == np.uint16:
        image = image >> 8
    elif image.dtype == np.float32:
        image = np.rint(255 * encode_srgb(np.clip(image, 0, 1)))
    image = image.astype(np.uint8)
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
