"""JPEG images compressed so strongly that color is left in blocks: dark and turbid scenes come out in patches of red and green."""

from collections.abc import Sequence
from contextlib import suppress

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.headers import JPEG_SIGNATURE, jpeg_segments
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.pairing import Pair

QUANTIZATION = 0xFFDB
"""Marker of the tables: of each, its precision and number, both 0 of that of luminance in 8 bits, and 64 steps."""
STANDARD_SUM = 3688
"""Of the 64 steps of quantization of luminance that quality 50 has: ITU T.81, table K.1."""
LEAST_QUALITY = 80
"""On dark frames of FLSea quality 60 leaves clear blocks of color, 75 faint ones, 85 hardly any."""


def jpeg_quality(content: bytes) -> int | None:
    """1 to 100, as the Independent JPEG Group counts it, of a JPEG's quantization of luminance; None of what is no JPEG."""
    if not content.startswith(JPEG_SIGNATURE):
        return None
    tables = b"".join(segment for marker, segment in jpeg_segments(content) if marker == QUANTIZATION)
    if len(tables) < 65 or tables[0] != 0:
        return None
    percent = 100 * sum(tables[1:65]) / STANDARD_SUM
    return round(100 - percent / 2 if percent <= 100 else 5000 / percent)


def compression_notes(pairs: Sequence[Pair]) -> tuple[str, ...]:
    """What to say of the compression of a dive's first image; nothing where it is weak, or the image cannot be read."""
    with suppress(InputError):  # the run names what cannot be read
        for pair in pairs[:1]:
            quality = jpeg_quality(read_image_bytes(pair.left))
            if quality is not None and quality < LEAST_QUALITY:
                return (
                    f"input: {pair.left.name} is a JPEG of quality {quality}: dark and turbid places may come out in blocks of "
                    "color; take the camera's own files, or quality 90 and above",
                )
    return ()
