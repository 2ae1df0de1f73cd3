"""Image headers, read before decoding: whether the file is complete, and the size of the image.

OpenCV decodes a truncated PNG or JPEG to a picture that is partly gray or black and says nothing.
Such pixels would be matched, colored and mapped; so wholeness is checked here, from the file
formats' own marks, before any pixel is decoded.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from stereo_seecolor.errors import InputError

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8"
JPEG_APP0, JPEG_APP1, JPEG_SCAN = 0xFFE0, 0xFFE1, 0xFFDA
"""Markers of segments (ITU T.81)."""
EXIF_PREFIX = b"Exif\x00\x00"
"""Before the EXIF block of a JPEG."""
PNG_FINISHED = (b"\x08\x02", b"\x08\x06")  # bits and color type: RGB and RGBA
TIFF_SIGNATURES = (b"II*\x00", b"MM\x00*")
BMP_SIGNATURE = b"BM"
# pgm and ppm of the netpbm manual: binary
NETPBM_HEADER = re.compile(rb"P([56])" + 3 * rb"(?:\s|#[^\n]*\n)+(\d+)" + rb"\s")
TIFF_WIDTH, TIFF_HEIGHT = 256, 257  # tags (TIFF 6.0)
TIFF_SHORT = 3  # kind of a value: two bytes
TIFF_SUBFILE, TIFF_NOT_A_PAGE = 254, 0b101  # tag; bits of a preview and of a mask
TIFF_COMPRESSION, TIFF_UNCOMPRESSED = 259, 1
JPEG_FRAMES = frozenset(range(0xFFC0, 0xFFD0)) - {0xFFC4, 0xFFC8, 0xFFCC}
"""Markers before the size of a JPEG (ITU T.81, table B.1)."""

MAX_PIXELS = 150_000_000
"""The largest cameras have as many; more is a damaged header."""


def refuse_large(path: Path, width: int, height: int, channels: int = 1) -> None:
    """Raise InputError for a size that no camera has: a small file may claim, and hold, gigabytes.

    Up to four channels count as one.
    """
    if width * height * max(channels, 4) > 4 * MAX_PIXELS:
        raise InputError(
            f"{path}: claims {width}x{height} pixels, more than {MAX_PIXELS / 1e6:g} million: not "
            "read"
        )


def image_size(content: bytes) -> tuple[int, int]:
    """Read (width, height) from the header of a complete PNG, JPEG, TIFF, BMP, PGM or PPM.

    Raises ValueError, saying what is wrong, if it is none of these, truncated or damaged.
    """
    if content.startswith(PNG_SIGNATURE):
        return _png_size(content)
    if content.startswith(JPEG_SIGNATURE):
        return _jpeg_size(content)
    if content.startswith(TIFF_SIGNATURES):
        return _tiff_size(content)
    if content.startswith(BMP_SIGNATURE):
        return _bmp_size(content)
    if header := NETPBM_HEADER.match(content):
        return _netpbm_size(content, header)
    raise ValueError("is not a PNG, TIFF, JPEG, BMP or binary PGM or PPM image")


def stated_size(content: bytes) -> tuple[int, int] | tuple[()]:
    """(width, height) by the header alone of a PNG, TIFF or JPEG; () where it states none."""
    with suppress(KeyError, struct.error):
        if content.startswith(PNG_SIGNATURE):
            width, height = struct.unpack_from(">2I", content, 16)
            return width, height
        if content.startswith(TIFF_SIGNATURES):
            tags = tiff_numbers(content)
            return tags[TIFF_WIDTH], tags[TIFF_HEIGHT]
        for marker, segment in jpeg_segments(content):
            if marker in JPEG_FRAMES:
                height, width = struct.unpack_from(">2H", segment, 1)
                return width, height
    return ()


def is_finished_color(content: bytes) -> bool:
    """Tell from the header alone whether a camera has made colors of 8 bits: any JPEG, a PNG of
    several channels and 8 bits.

    Nothing is checked: see image_size.
    """
    return content.startswith(JPEG_SIGNATURE) or (
        content.startswith(PNG_SIGNATURE) and content[24:26] in PNG_FINISHED
    )


def exif_block(content: bytes) -> bytes:
    """The EXIF of a PNG, JPEG or TIFF as it stands in the file: a TIFF structure of its own; b""
    where there is none.

    A TIFF is such a structure as a whole. Nothing is checked: see image_size.
    """
    if content.startswith(TIFF_SIGNATURES):
        return content
    if content.startswith(PNG_SIGNATURE):
        return first_chunk(content, b"eXIf")
    return _jpeg_exif(content) if content.startswith(JPEG_SIGNATURE) else b""


def png_chunks(content: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind of each chunk of a PNG, and where its data lie. Raises struct.error for a cut one."""
    at = len(PNG_SIGNATURE)
    while at < len(content):
        length, kind = struct.unpack_from(">I4s", content, at)
        yield kind, at + 8, at + 8 + length
        at += length + 12


def first_chunk(content: bytes, wanted: bytes) -> bytes:
    """The data of a PNG's first chunk of this kind, such as eXIf and PLTE; b"" without one."""
    with suppress(struct.error):
        for kind, start, end in png_chunks(content):
            if kind == wanted:
                return content[start:end]
    return b""


def _jpeg_exif(content: bytes) -> bytes:
    for marker, segment in jpeg_segments(content):
        if marker == JPEG_APP1 and segment.startswith(EXIF_PREFIX):
            return segment.removeprefix(EXIF_PREFIX)
    return b""


def jpeg_segments(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Marker and content of each whole segment of a JPEG before its pixels (T.81, B.1.1.4)."""
    position = len(JPEG_SIGNATURE)
    while position + 4 <= len(content):
        marker, length = struct.unpack_from(">HH", content, position)
        if marker == JPEG_SCAN or length < 2:
            break
        yield marker, content[position + 4 : position + 2 + length]
        position += 2 + length


JPEG_QUANTIZATION = 0xFFDB
"""Marker of the tables: of each, its precision and number, both 0 of that of luminance in 8 bits,
and 64 steps.
"""


def jpeg_quantization(content: bytes) -> bytes:
    """The 64 steps by which a JPEG's luminance is quantized, the first that of a block's mean times
    8; empty for what is not a JPEG of 8 bits.
    """
    if not content.startswith(JPEG_SIGNATURE):
        return b""
    tables = b"".join(
        segment for marker, segment in jpeg_segments(content) if marker == JPEG_QUANTIZATION
    )
    return tables[1:65] if len(tables) >= 65 and tables[0] == 0 else b""


def _png_size(content: bytes) -> tuple[int, int]:
    size = None
    with suppress(struct.error):
        for kind, start, end in png_chunks(content):
            if zlib.crc32(content[start - 4 : end]) != struct.unpack_from(">I", content, end)[0]:
                raise ValueError(
                    f"is damaged (PNG chunk {kind.decode('latin1')!r} at byte {start - 8} has a "
                    "wrong checksum)"
                )
            if kind == b"IHDR" and end - start == 13:
                size = stated_size(content)
            if kind == b"IEND" and size:
                return size
    raise ValueError("is truncated (the PNG ends before its end mark)")


def _jpeg_size(content: bytes) -> tuple[int, int]:
    position = len(JPEG_SIGNATURE)
    size = None
    while position + 4 <= len(content):
        marker, length = struct.unpack_from(">HH", content, position)
        if marker < 0xFF00 or length < 2:
            raise ValueError(f"is damaged (no JPEG marker at byte {position})")
        if marker in JPEG_FRAMES and position + 9 <= len(content):
            height, width = struct.unpack_from(">HH", content, position + 5)
            size = (width, height)
        # the scan follows; inside it every 0xFF is escaped, so an end mark is an end mark
        if marker == JPEG_SCAN and size:
            if content.find(b"\xff\xd9", position) < 0:
                raise ValueError("is truncated (the JPEG ends before its end mark)")
            return size
        position += 2 + length
    raise ValueError("is truncated (the JPEG ends before its picture)")


def _tiff_size(content: bytes) -> tuple[int, int]:
    try:
        tags = tiff_numbers(content)
    except struct.error as error:
        raise ValueError(
            "is truncated (the TIFF's directory lies beyond the end of the file)"
        ) from error
    if TIFF_WIDTH not in tags or TIFF_HEIGHT not in tags:
        raise ValueError("is damaged (the TIFF states no width and height)")
    return tags[TIFF_WIDTH], tags[TIFF_HEIGHT]


def tiff_numbers(content: bytes) -> dict[int, int]:
    """Tag -> number of the first page of a TIFF; of what is longer than a number, where it lies.

    Raises struct.error if it is cut.
    """
    return next(_tiff_directories(content), {})


def tiff_pages(content: bytes) -> int:
    """The number of pictures of a TIFF, without previews and masks; of a cut one, those before."""
    count = 0
    with suppress(struct.error):
        for tags in _tiff_directories(content):
            count += not tags.get(TIFF_SUBFILE, 0) & TIFF_NOT_A_PAGE
    return count


def _tiff_directories(content: bytes) -> Iterator[dict[int, int]]:
    """The numbers of each directory, the first page's first. Raises struct.error for a cut one."""
    order, seen = "<" if content[:1] == b"I" else ">", {0}  # after the last one
    (directory,) = struct.unpack_from(order + "I", content, 4)
    while directory not in seen:
        seen.add(directory)
        (count,) = struct.unpack_from(order + "H", content, directory)
        numbers, end = {}, directory + 2 + 12 * count
        for place in range(directory + 2, end, 12):
            tag, kind, length = struct.unpack_from(order + "HHI", content, place)
            value = "H" if kind == TIFF_SHORT and length == 1 else "I"
            (numbers[tag],) = struct.unpack_from(order + value, content, place + 8)
        yield numbers
        (directory,) = struct.unpack_from(order + "I", content, end)


def _bmp_size(content: bytes) -> tuple[int, int]:
    try:
        pixels, _, width, height, _, bits, compression = struct.unpack_from("<IIiiHHI", content, 10)
    except struct.error as error:
        raise ValueError("is truncated (the BMP ends within its header)") from error
    if width <= 0 or height == 0:
        raise ValueError("is damaged (the BMP states no width and height)")
    row_bytes = (width * bits + 31) // 32 * 4
    # rows from the top down have a negative height
    if not compression and len(content) < pixels + row_bytes * abs(height):
        raise ValueError("is truncated (the BMP ends before its last row)")
    return width, abs(height)


def _netpbm_size(content: bytes, header: re.Match[bytes]) -> tuple[int, int]:
    kind, width, height, highest = map(int, header.groups())
    bytes_a_pixel = (1 if kind == 5 else 3) * (1 if highest < 256 else 2)
    if len(content) - header.end() < width * height * bytes_a_pixel:
        raise ValueError("is truncated (the PGM or PPM ends before its last row)")
    return width, height
