"""Encoding of arrays to file contents. The settings were chosen by measurement: see
docs/performance.md.
"""

import struct
import zlib
from collections.abc import Mapping
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms
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

from stereo_seecolor.records import Map, is_monochrome

# Deflate compression (RFC 1950) of PNG, TIFF and the page's data; any program can inflate it.

try:
    from isal.isal_zlib import compress as fast_compress
    from isal.isal_zlib import decompressobj as fast_inflater
    from isal.isal_zlib import error as fast_error
except ImportError:  # no wheel for this machine: the same content, in more time

    def fast_compress(content: bytes | memoryview, level: int) -> bytes:  # type: ignore[misc]  # noqa: D103
        runs = zlib.compressobj(level, strategy=zlib.Z_RLE)
        return runs.compress(content) + runs.flush()

    fast_inflater, fast_error = zlib.decompressobj, zlib.error  # type: ignore[assignment]

FAST_LEVEL = 1
"""Of ISA-L: 12 ms for the 4 MB of a filtered picture of 1.3 megapixels. Level 0 gives 36 % more, 2
and 3 the same.
"""


def deflated(content: bytes | memoryview, repeats: bool = False) -> bytes:
    """A zlib stream, by Intel's ISA-L, which runs on ARM too. Filtered pictures are mostly noise:
    zlib's levels 6 to 9 find 5 to 8 % in them by chance, in 20 times the time.

    repeats: by zlib's level 6, for what does repeat: the triangles of a mesh take a fifth less, at
    0.2 s a million.
    """
    if repeats:
        return zlib.compress(content, 6)
    return bytes(fast_compress(content, FAST_LEVEL))


def inflated(content: bytes | memoryview, size: int) -> bytes:
    """The ``size`` bytes of a zlib stream. Raises ValueError if it holds fewer or more, which are
    not inflated, or is damaged.
    """
    inflater = fast_inflater()
    try:
        found = bytes(inflater.decompress(content, size + 1))
    except (zlib.error, fast_error) as error:  # type: ignore[misc]  # a class, whatever its stub says
        raise ValueError(str(error)) from error
    if len(found) != size or not inflater.eof:
        raise ValueError(f"does not hold {size} bytes")
    return found


# PNG encoding with a fixed row filter and a fast deflate: a third of the time that OpenCV takes.

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GRAY, PNG_RGB = 0, 2
UNFILTERED, AVERAGE = 0, 3
Chunks = Mapping[bytes, bytes]
"""Kind -> data, in the order in which they are written."""


def encode_png(pixels: NDArray[np.generic], chunks: Chunks | None = None) -> bytes:
    """Encode (H, W), or (H, W, 3) RGB, of uint8 or uint16. chunks: further ones, written before the
    pixels.
    """
    return _file(pixels, deflated(_averaged(pixels).data), chunks or {})


def encode_codes(codes: NDArray[np.uint8]) -> bytes:
    """Encode an image (H, W) of few different values without a row filter: such rows deflate better
    as they are.
    """
    # the first byte of a row: UNFILTERED
    rows = np.zeros((codes.shape[0], codes.shape[1] + 1), np.uint8)
    rows[:, 1:] = codes
    return _file(codes, deflated(rows.data), {})


def _averaged(pixels: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Rows of bytes, each less the mean of its left and its upper neighbor (filter 3 of PNG), the
    filter's number before them.

    The mean of two bytes without a carry: what both have, and half of where they differ.
    """
    height = pixels.shape[0]
    stored = pixels.astype(pixels.dtype.newbyteorder(">"), copy=False)
    values = np.ascontiguousarray(stored).view(np.uint8).reshape(height, -1)
    step = values.shape[1] // pixels.shape[1]
    rows = np.empty((height, values.shape[1] + 1), np.uint8)
    rows[:, 0] = AVERAGE
    mean, both = np.zeros_like(values), np.zeros_like(values)
    mean[1:, step:] = values[:-1, step:] ^ values[1:, :-step]
    mean[1:, :step], mean[0, step:] = values[:-1, :step], values[0, :-step]
    mean >>= 1
    np.bitwise_and(values[:-1, step:], values[1:, :-step], out=both[1:, step:])
    mean += both
    np.subtract(values, mean, out=rows[:, 1:])
    return rows


def _file(pixels: NDArray[np.generic], data: bytes, chunks: Chunks) -> bytes:
    kind = GRAY if pixels.ndim == 2 else PNG_RGB
    header = struct.pack(
        ">2I5B", pixels.shape[1], pixels.shape[0], 8 * pixels.dtype.itemsize, kind, 0, 0, 0
    )
    parts = {b"IHDR": header, **chunks, b"IDAT": data, b"IEND": b""}
    return b"".join([SIGNATURE, *(_chunk(kind, content) for kind, content in parts.items())])


def _chunk(kind: bytes, content: bytes) -> bytes:
    return b"".join(
        [
            struct.pack(">I", len(content)),
            kind,
            content,
            struct.pack(">I", zlib.crc32(content, zlib.crc32(kind))),
        ]
    )


# TIFF encoding: images with their camera's EXIF, which OpenCV does not write; maps deflated in an
# eighth of its time.

EXIF_PREFIX = b"Exif\x00\x00"
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
    """Encode a map (H, W) of float32 as a deflated TIFF: half the size of an uncompressed range
    map.
    """
    content = deflated(_differences(values).data)
    tags = Image.Exif()
    tags.endian = "<"
    tags.update(_tags(values, len(content)) | {COMPRESSION: DEFLATED, PREDICTOR: FLOATING_POINT})
    return b"".join([tags.tobytes().removeprefix(EXIF_PREFIX), content])


def _differences(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Rows of first all highest bytes, then all second ones and so on, each byte less its left
    neighbor.
    """
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


ImageFormat = Literal["png", "png16", "tiff", "tiff32", "jpg"]
JPEG_QUALITY = 95  # no blocks are seen; above, files grow fast


def encode_image(rgb: NDArray[np.generic], image_format: ImageFormat, exif: bytes = b"") -> bytes:
    """Encode an RGB image (H, W, 3); it is written as one channel where red, green and blue are
    equal everywhere.

    png and tiff keep 8 or 16 bits; png16 scales 8 bits up to 16; jpg takes 8 bits (16 are scaled
    down); tiff32 takes float32.
    exif: a Capture's block. It is embedded, and in png and jpg the sRGB profile (of color images).
    """
    if image_format == "png16" and rgb.dtype == np.uint8:
        rgb = rgb.astype(np.uint16) * 257
    if image_format == "jpg" and rgb.dtype == np.uint16:
        rgb = (rgb // 257).astype(np.uint8)
    mono = is_monochrome(rgb)
    pixels = rgb[..., 0] if mono else rgb
    if image_format in ("tiff", "tiff32"):
        return encode_tiff(pixels, exif)
    if image_format == "jpg":
        return _encode_jpeg(
            pixels,
            {cv2.IMAGE_METADATA_EXIF: exif, cv2.IMAGE_METADATA_ICCP: b"" if mono else SRGB_PROFILE},
        )
    chunks = {} if mono else {b"iCCP": SRGB_CHUNK}
    return encode_png(pixels, {**chunks, b"eXIf": exif} if exif else chunks)


def encode_map(values: Map, compact: bool = False) -> bytes:
    """Encode a map (H, W) of float32 as TIFF; compact: deflated."""
    values = values.astype(np.float32, copy=False)
    return encode_deflated(values) if compact else encode_tiff(values)


def rounded(values: Map) -> Map:
    """Round (H, W) float32 to 9 significant bits, which deflate to 40 % of the size: standard
    errors are not known to 0.2 %.
    """
    bits = values.astype(np.float32).view(np.uint32)
    nearest = ((bits + np.uint32(1 << 14)) & np.uint32(0xFFFF8000)).view(np.float32)
    return np.where(np.isfinite(values), nearest, values).astype(np.float32)


def encode_depth_mm(depth_m: Map) -> bytes:
    """Encode depths (H, W), meters, NaN unknown, as a 16-bit PNG in millimeters, 0 where unknown or
    beyond 65.535 m.
    """
    depth_mm = np.round(1000 * np.nan_to_num(depth_m))
    return encode_png(np.where(depth_mm <= np.iinfo(np.uint16).max, depth_mm, 0).astype(np.uint16))


def encode_confidence(confidence: Map) -> bytes:
    """Encode a confidence (H, W) in [0, 1] as an 8-bit PNG, 255 = 1; rounded up, so that 0 is kept
    for what was not measured.
    """
    return encode_codes(np.ceil(confidence * 255).astype(np.uint8))


def encode_mask(mask: NDArray[np.uint8]) -> bytes:
    """Encode a mask (H, W) of uint8 codes as a PNG."""
    return encode_codes(mask)


def _srgb_profile() -> bytes:
    """The ICC profile of sRGB, with a date of creation that never changes, so that equal images are
    equal files.
    """
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return profile[:24] + struct.pack(">6H", 2000, 1, 1, 0, 0, 0) + profile[36:]


SRGB_PROFILE = _srgb_profile()
# the profile's name, and that it is deflated
SRGB_CHUNK = b"sRGB\0\0" + zlib.compress(SRGB_PROFILE)
"""Content of a PNG's iCCP."""


def _encode_jpeg(pixels: NDArray[np.generic], metadata: dict[int, bytes]) -> bytes:
    metadata = {kind: block for kind, block in metadata.items() if block}
    blocks = [np.frombuffer(block, np.uint8) for block in metadata.values()]
    stored = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    encoded: NDArray[np.uint8]
    _, encoded = cv2.imencodeWithMetadata(
        ".jpg", stored, list(metadata), blocks, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    return encoded.tobytes()


# Replacement of the EXIF block of an image file, with the pixels unchanged.

PNG_SIGNATURE, PNG_EXIF = b"\x89PNG\r\n\x1a\n", b"eXIf"
PNG_FRAME = 12  # bytes of a chunk beside its data: length, kind, checksum
JPEG_SIGNATURE, JPEG_APP0, JPEG_APP1, JPEG_SCAN = b"\xff\xd8", 0xFFE0, 0xFFE1, 0xFFDA


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
    chunk = PNG_EXIF + block
    pieces, position = [PNG_SIGNATURE], len(PNG_SIGNATURE)
    while position < len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        if kind != PNG_EXIF:
            pieces.append(content[position : position + PNG_FRAME + length])
        if kind == b"IHDR":
            pieces.append(
                struct.pack(">I", len(block)) + chunk + struct.pack(">I", zlib.crc32(chunk))
            )
        position += PNG_FRAME + length
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
