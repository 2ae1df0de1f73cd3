"""Pictures as uncompressed TIFF with the EXIF of their camera, which OpenCV does not write."""

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
    ROWSPERSTRIP,
    SAMPLEFORMAT,
    SAMPLESPERPIXEL,
    STRIPBYTECOUNTS,
    STRIPOFFSETS,
)

EXIF_PREFIX = b"Exif\x00\x00"
UNCOMPRESSED, BLACK_IS_ZERO, RGB = 1, 1, 2
UNSIGNED, FLOAT = 1, 3


def encode_tiff(image: NDArray[np.generic], exif: bytes = b"") -> bytes:
    """(H, W) or (H, W, 3) RGB of uint8, uint16 or float32 to a file's content, in one strip. exif: a Capture's block, or b""."""
    tags = Image.Exif()
    if exif:
        tags.load(EXIF_PREFIX + exif)
    tags.endian = tags.endian or "<"
    order: Literal["<", ">"] = "<" if tags.endian == "<" else ">"
    pixels = image.astype(image.dtype.newbyteorder(order), copy=False).tobytes()
    channels = 1 if image.ndim == 2 else image.shape[2]
    tags.update(
        {
            IMAGEWIDTH: image.shape[1],
            IMAGELENGTH: image.shape[0],
            BITSPERSAMPLE: (8 * image.dtype.itemsize,) * channels,
            COMPRESSION: UNCOMPRESSED,
            PHOTOMETRIC_INTERPRETATION: BLACK_IS_ZERO if channels == 1 else RGB,
            SAMPLESPERPIXEL: channels,
            ROWSPERSTRIP: image.shape[0],
            SAMPLEFORMAT: (FLOAT if image.dtype.kind == "f" else UNSIGNED,) * channels,
            STRIPOFFSETS: 0,  # counted by Pillow from the end of the tags
            STRIPBYTECOUNTS: len(pixels),
        }
    )
    return tags.tobytes().removeprefix(EXIF_PREFIX) + pixels
