"""The program's own PNG and deflated TIFF back to arrays, in half the time that OpenCV takes; png.py and tiff.py write them."""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.files.deflate import inflated
from stereo_seecolor.files.png import AVERAGE, GRAY, RGB, SIGNATURE, UNFILTERED
from stereo_seecolor.files.tiff import DEFLATED, FLOATING_POINT

COMPRESSION, PREDICTOR, WIDTH, HEIGHT, BITS, STRIP, STRIP_BYTES = 259, 317, 256, 257, 258, 273, 279
SHORT = 3


def quickly_decoded(content: bytes) -> NDArray[Any] | None:
    """(H, W), or (H, W, 3) RGB; None for a file of any other form, and for one that is cut short or damaged."""
    try:
        if content.startswith(SIGNATURE):
            return _png(content)
        return _tiff(content) if content.startswith(b"II*\0") else None
    except (ValueError, KeyError, struct.error):
        return None


def _png(content: bytes) -> NDArray[np.uint8] | None:
    """One of 8 bits whose rows all have the filter that we write."""
    chunks: dict[bytes, bytes] = {}
    at = len(SIGNATURE)
    while at < len(content):
        length, kind = struct.unpack_from(">I4s", content, at)
        chunks[kind] = chunks.get(kind, b"") + content[at + 8 : at + 8 + length]
        at += length + 12
    width, height, bits, kind, _, _, interlaced = struct.unpack(">2I5B", chunks[b"IHDR"])
    if bits != 8 or kind not in (GRAY, RGB) or interlaced or b"IEND" not in chunks:
        return None
    channels = 1 if kind == GRAY else 3
    rows = np.frombuffer(inflated(chunks[b"IDAT"]), np.uint8).reshape(height, width * channels + 1)
    if (rows[:, 0] == UNFILTERED).all():
        pixels = rows[:, 1:].copy()
    elif (rows[:, 0] == AVERAGE).all():
        pixels = np.empty((height, width * channels), np.uint8)
        _add_averages(rows, channels, pixels)
    else:
        return None
    return pixels if channels == 1 else pixels.reshape(height, width, 3)


def _tiff(content: bytes) -> NDArray[np.float32] | None:
    """One deflated strip of float32 with the predictor of floating point."""
    (at,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, at)
    entries = (struct.unpack_from("<HHII", content, at + 2 + 12 * i) for i in range(count))
    tags = {tag: value & 0xFFFF if kind == SHORT else value for tag, kind, length, value in entries if length == 1}
    if tags[COMPRESSION] != DEFLATED or tags[PREDICTOR] != FLOATING_POINT or tags[BITS] != 32:
        return None
    strip = content[tags[STRIP] : tags[STRIP] + tags[STRIP_BYTES]]
    rows = np.frombuffer(inflated(strip), np.uint8).reshape(tags[HEIGHT], 4 * tags[WIDTH])
    values = np.empty((tags[HEIGHT], tags[WIDTH], 4), np.uint8)
    _add_differences(rows, values)
    return values.view("<f4")[..., 0].astype(np.float32, copy=False)


@compiled
def _add_averages(rows, step, pixels):  # type: ignore[no-untyped-def]
    """Undo filter 3 of PNG: ``rows`` begin with the filter's number, ``step`` bytes are a pixel."""
    height, width = pixels.shape
    for row in range(height):
        for i in range(width):
            left = np.uint32(pixels[row, i - step]) if i >= step else np.uint32(0)
            upper = np.uint32(pixels[row - 1, i]) if row > 0 else np.uint32(0)
            pixels[row, i] = (rows[row, i + 1] + ((left + upper) >> 1)) & 255


@compiled
def _add_differences(rows, values):  # type: ignore[no-untyped-def]
    """Undo the predictor: bytes less their left neighbor, the highest of all pixels first."""
    height, width, _ = values.shape
    for row in range(height):
        total = 0
        for place in range(4):
            for column in range(width):
                total = (total + rows[row, place * width + column]) & 255
                values[row, column, 3 - place] = total
