"""TIFF encoding: images with EXIF, which OpenCV does not write; maps deflated fast."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.TiffImagePlugin import (
    BITSPERSAMPLE,
    COMPRESSION,
    IMAGELENGTH,
    IMAGEWIDTH,
    PHOTOMETRIC_INTERPRETATION,
    PREDICTOR,
    ROWSPERSTRIP,
    SAMPLEFORMAT,
    SAMPLESPERPIXEL,
    STRIPBYTECOUNTS,
    STRIPOFFSETS,
)

from stereo_seecolor.files.deflate import deflated
from stereo_seecolor.files.image_headers import EXIF_PREFIX

UNCOMPRESSED, DEFLATED, BLACK_IS_ZERO, TIFF_RGB = 1, 8, 1, 2
FLOATING_POINT = 3
"""Predictor of Adobe's Photoshop TIFF Technical Note 3."""
UNSIGNED, FLOAT = 1, 3


def encode_tiff(image: NDArray[np.generic], exif: bytes = b"") -> bytes:
    """Encode (H, W), or (H, W, 3) RGB, of uint8, uint16 or float32, in one strip. exif: a Capture's
    block, or b"".
    """
    tags = Image.Exif()
    if exif:
        tags.load(EXIF_PREFIX + exif)
    tags.endian = tags.endian or "<"
    order: Literal["<", ">"] = "<" if tags.endian == "<" else ">"
    pixels = image.astype(image.dtype.newbyteorder(order), copy=False)
    tags.update(_tags(image, pixels.nbytes))
    return b"".join(
        [tags.tobytes().removeprefix(EXIF_PREFIX), np.ascontiguousarray(pixels).data.cast("B")]
    )


def encode_deflated(values: NDArray[np.float32]) -> bytes:
    """Encode a map (H, W) of float32 as a deflated TIFF, of half the size."""
    content = deflated(_differences(values).data)
    tags = Image.Exif()
    tags.endian = "<"
    tags.update(_tags(values, len(content)) | {COMPRESSION: DEFLATED, PREDICTOR: FLOATING_POINT})
    return b"".join([tags.tobytes().removeprefix(EXIF_PREFIX), content])


def _differences(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Rows of all highest bytes, then all second and so on, each less its left neighbor."""
    height, width = values.shape
    planes = (
        np.ascontiguousarray(values.astype(">f4"))
        .view(np.uint8)
        .reshape(height, width, 4)
        .transpose(0, 2, 1)
    )
    rows = planes.reshape(height, 4 * width)
    differences = rows.copy()
    differences[:, 1:] -= rows[:, :-1]
    return differences


def _tags(image: NDArray[np.generic], size: int) -> dict[int, object]:
    """Of a file with one strip of ``size`` bytes."""
    channels = 1 if image.ndim == 2 else image.shape[2]
    return {
        IMAGEWIDTH: image.shape[1],
        IMAGELENGTH: image.shape[0],
        BITSPERSAMPLE: (8 * image.dtype.itemsize,) * channels,
        COMPRESSION: UNCOMPRESSED,
        PHOTOMETRIC_INTERPRETATION: BLACK_IS_ZERO if channels == 1 else TIFF_RGB,
        SAMPLESPERPIXEL: channels,
        ROWSPERSTRIP: image.shape[0],
        SAMPLEFORMAT: (FLOAT if image.dtype.kind == "f" else UNSIGNED,) * channels,
        STRIPOFFSETS: 0,  # counted by Pillow from the end of the tags
        STRIPBYTECOUNTS: size,
    }
