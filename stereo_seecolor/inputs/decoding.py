"""Decoding of an image file's content to pixels as they are stored."""

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.image_headers import (
    PNG_SIGNATURE,
    TIFF_SIGNATURES,
    exif_block,
    image_size,
)
from stereo_seecolor.files.png_decoding import is_compiled, quickly_decoded
from stereo_seecolor.inputs.seams import refuse_broken_stream

MAX_PIXELS = 150_000_000  # the largest cameras have 150 million; more is a damaged header


def decode_raw(content: bytes, path: Path, flags: int) -> NDArray[np.generic]:
    """The pixels as cv2.imdecode gives them with these flags. Raises InputError, as read_image."""
    pixels, is_rgb = decoded(content, path, flags)
    return cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if is_rgb else pixels


def decoded(content: bytes, path: Path, flags: int) -> tuple[NDArray[np.generic], bool]:
    """Decode to pixels, and tell whether they are RGB: colors of OpenCV are BGR."""
    try:
        width, height = image_size(content)
    except ValueError as error:
        raise InputError(
            f"{path}: {error}: copy it again from the vehicle, or leave it out"
        ) from error
    if width * height > MAX_PIXELS:
        raise InputError(
            f"{path}: claims {width}x{height} pixels, more than {MAX_PIXELS / 1e6:g} million: not "
            "read"
        )
    if content.startswith(TIFF_SIGNATURES):
        refuse_broken_stream(content, path)
    # OpenCV turns what EXIF says is turned
    if (
        "numba" in sys.modules
        and content.startswith(PNG_SIGNATURE)
        and not exif_block(content)
        and is_compiled()
    ):
        quick = quickly_decoded(content)
        if quick is not None:
            return quick, quick.ndim == 3
    try:
        pixels: NDArray[np.generic] | None = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error as error:
        raise InputError(f"{path}: cannot be decoded: {error.err}") from error
    if pixels is None:
        raise InputError(
            f"{path}: cannot be decoded (damaged, or in a format that OpenCV does not read)"
        )
    return pixels, False
