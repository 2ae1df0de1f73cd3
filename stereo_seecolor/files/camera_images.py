"""Decoding of the image files of cameras to pixels as they are stored; damaged ones are refused."""

import io
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL.TiffImagePlugin import (
    STRIPBYTECOUNTS,
    STRIPOFFSETS,
    TILEBYTECOUNTS,
    TILEOFFSETS,
    TiffImageFile,
)

from calibration.quiet import ignored_warnings
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.image_headers import (
    PNG_SIGNATURE,
    TIFF_COMPRESSION,
    TIFF_SIGNATURES,
    TIFF_UNCOMPRESSED,
    exif_block,
    image_size,
    refuse_large,
    tiff_numbers,
)
from stereo_seecolor.files.png_decoding import is_compiled, quickly_decoded

DEFLATED = (8, 32946)
"""Compressions of TIFF: Adobe's number and the older one."""


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
    refuse_large(path, width, height)
    if content.startswith(TIFF_SIGNATURES):
        _refuse_broken_stream(content, path)
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


def _refuse_broken_stream(content: bytes, path: Path) -> None:
    """Raise InputError for a TIFF with a broken stream: OpenCV decodes what is left."""
    try:
        if tiff_numbers(content).get(TIFF_COMPRESSION, TIFF_UNCOMPRESSED) == TIFF_UNCOMPRESSED:
            return
        with ignored_warnings():  # of damaged tags
            image = TiffImageFile(io.BytesIO(content))
        _unpack(image, content)
    except _BrokenStreamError as error:
        raise InputError(
            f"{path}: is damaged: its compressed pixels cannot be unpacked ({error})"
        ) from error
    except Exception:
        # Pillow raises errors of many kinds for what it does not read; OpenCV judges that
        return


class _BrokenStreamError(Exception):
    """Compressed pixels that cannot be unpacked."""


def _unpack(image: TiffImageFile, content: bytes) -> None:
    try:
        if image.tag_v2[TIFF_COMPRESSION] in DEFLATED:  # whose checksums libtiff does not look at
            for place, length in zip(*(image.tag_v2[tag] for tag in _places(image)), strict=True):
                zlib.decompress(content[place : place + length])
        else:
            image.load()
    except (OSError, ValueError, zlib.error) as error:
        raise _BrokenStreamError(str(error)) from error


def _places(image: TiffImageFile) -> tuple[int, int]:
    """The tags of where the parts of the pixels lie, and of how long they are."""
    return (
        (TILEOFFSETS, TILEBYTECOUNTS)
        if TILEOFFSETS in image.tag_v2
        else (STRIPOFFSETS, STRIPBYTECOUNTS)
    )
