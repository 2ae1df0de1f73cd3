"""Decoding of 8-bit PNG in half the time that OpenCV takes."""

import struct

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.files.deflate import inflated
from stereo_seecolor.files.image_headers import PNG_SIGNATURE, png_chunks
from stereo_seecolor.files.png import AVERAGE, GRAY, PNG_RGB

SUB, UP, PAETH = 1, 2, 4
"""Filters of PNG that other programs use."""
_compiled: list[bool] = []


def is_compiled() -> bool:
    """False while machine code to decode PNG could be kept on disk and is not there yet: before a
    first run, OpenCV takes less.
    """
    if not _compiled and not _unfilter.missing:
        _compiled.append(True)
    return bool(_compiled)


def quickly_decoded(content: bytes) -> NDArray[np.uint8] | None:
    """Decode a PNG of 8 bits to (H, W), or (H, W, 3) RGB; None for a file of any other form, and
    for one that is truncated or damaged.
    """
    try:
        return _png(content) if content.startswith(PNG_SIGNATURE) else None
    except (ValueError, KeyError, struct.error):
        return None


def _png(content: bytes) -> NDArray[np.uint8] | None:
    """One of 8 bits, gray or RGB, not interlaced and not transparent."""
    chunks: dict[bytes, list[bytes]] = {}
    for kind, start, end in png_chunks(content):
        chunks.setdefault(kind, []).append(content[start:end])
    width, height, bits, kind, _, _, interlaced = struct.unpack(">2I5B", chunks[b"IHDR"][0])
    if (
        bits != 8
        or kind not in (GRAY, PNG_RGB)
        or interlaced
        or b"IEND" not in chunks
        or b"tRNS" in chunks
    ):
        return None
    channels = 1 if kind == GRAY else 3
    row = width * channels + 1
    rows = np.frombuffer(inflated(b"".join(chunks[b"IDAT"]), height * row), np.uint8).reshape(
        height, row
    )
    if rows[:, 0].max() > PAETH:
        return None
    pixels = np.empty((height, width * channels), np.uint8)
    _unfilter(rows, channels, pixels)
    return pixels if channels == 1 else pixels.reshape(height, width, 3)


@compiled
def _unfilter(rows, step, pixels):  # type: ignore[no-untyped-def]
    """Undo the filters of PNG (its specification, 9.2): ``rows`` begin with the filter's number,
    ``step`` bytes are a pixel.
    """
    height, width = pixels.shape
    for row in range(height):
        kind = rows[row, 0]
        for i in range(width):
            value = np.int32(rows[row, i + 1])
            left = np.int32(pixels[row, i - step]) if i >= step else np.int32(0)
            upper = np.int32(pixels[row - 1, i]) if row > 0 else np.int32(0)
            if kind == AVERAGE:
                value += (left + upper) >> 1
            elif kind == SUB:
                value += left
            elif kind == UP:
                value += upper
            elif kind == PAETH:
                corner = (
                    np.int32(pixels[row - 1, i - step]) if row > 0 and i >= step else np.int32(0)
                )
                by_left, by_upper = abs(upper - corner), abs(left - corner)
                by_corner = abs(left + upper - 2 * corner)
                if by_left <= by_upper and by_left <= by_corner:
                    value += left
                else:
                    value += upper if by_upper <= by_corner else corner
            pixels[row, i] = value & 255
