"""Replacement of the EXIF block of an image file, with the pixels unchanged."""

import struct

import cv2
import numpy as np

from stereo_seecolor.files.image_headers import (
    EXIF_PREFIX,
    JPEG_APP0,
    JPEG_APP1,
    JPEG_SCAN,
    JPEG_SIGNATURE,
    PNG_SIGNATURE,
    png_chunks,
)
from stereo_seecolor.files.png import png_chunk
from stereo_seecolor.files.tiff import encode_tiff

PNG_EXIF = b"eXIf"


def with_exif(content: bytes, block: bytes) -> bytes:
    """Replace the EXIF block (a TIFF structure) of a PNG, JPEG or TIFF as this program writes them;
    return the new content.
    """
    if content.startswith(PNG_SIGNATURE):
        return _png(content, block)
    if content.startswith(JPEG_SIGNATURE):
        return _jpeg(content, block)
    pixels = np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED))
    return encode_tiff(
        np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)) if pixels.ndim == 3 else pixels, block
    )


def _png(content: bytes, block: bytes) -> bytes:
    pieces = [PNG_SIGNATURE]
    for kind, start, end in png_chunks(content):
        pieces += [content[start - 8 : end + 4]] if kind != PNG_EXIF else []
        pieces += [png_chunk(PNG_EXIF, block)] if kind == b"IHDR" else []
    return b"".join(pieces)


def _jpeg(content: bytes, block: bytes) -> bytes:
    before, rest, position = [JPEG_SIGNATURE], [], len(JPEG_SIGNATURE)
    while True:
        marker, length = struct.unpack_from(">HH", content, position)
        segment = content[position : position + 2 + length]
        if marker == JPEG_SCAN:
            rest.append(content[position:])
            break
        if marker == JPEG_APP0:
            before.append(segment)
        elif not (marker == JPEG_APP1 and segment[4:].startswith(EXIF_PREFIX)):
            rest.append(segment)
        position += 2 + length
    exif = EXIF_PREFIX + block
    return b"".join([*before, struct.pack(">HH", JPEG_APP1, len(exif) + 2) + exif, *rest])
