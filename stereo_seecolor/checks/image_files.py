"""Checks of the form of image files: pages, palettes, compression, cropped images. Images that
cannot be read are left out: the run names them.
"""

from contextlib import suppress

from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, DiveVerdict
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.image_headers import (
    PNG_SIGNATURE,
    TIFF_SIGNATURES,
    first_chunk,
    image_size,
    jpeg_quantization,
    tiff_pages,
)
from stereo_seecolor.inputs.capture import framing
from stereo_seecolor.inputs.images import read_image_bytes

PALETTE = 3
"""Color type of a PNG (its specification, 11.2.2)."""


def form(images: DiveImages) -> DiveVerdict:
    """Pages or a palette in the files of the left images."""
    for pair in images.pairs[:1]:
        with suppress(InputError):
            content = read_image_bytes(pair.left)
            if content.startswith(TIFF_SIGNATURES) and (pages := tiff_pages(content)) > 1:
                note = (
                    f"input: {pair.left.name} holds {pages} pages; only the first is read: save "
                    "each page as a separate file"
                )
                return DiveVerdict((note,))
            if content.startswith(PNG_SIGNATURE) and _has_palette_of_colors(content):
                rounded = (
                    f"has a palette of {len(first_chunk(content, b'PLTE')) // 3} colors, so its "
                    "colors were rounded"
                )
                note = (
                    f"input: {pair.left.name} {rounded}: colors will be wrong; use the camera's "
                    "original files"
                )
                return DiveVerdict((note,), COLORS)
    return NOTHING_FOUND


def _has_palette_of_colors(content: bytes) -> bool:
    palette = first_chunk(content, b"PLTE")
    return content[25] == PALETTE and palette[::3] != palette[1::3]


STANDARD_SUM = 3688
"""Of the 64 steps of quantization of luminance that quality 50 has: ITU T.81, table K.1."""
LEAST_QUALITY = 80
"""On dark frames of FLSea quality 60 leaves clear blocks of color, 75 faint ones, 85 hardly any."""


def jpeg_quality(content: bytes) -> int | None:
    """1 to 100, as the Independent JPEG Group counts it, of a JPEG's quantization of luminance;
    None of what is not a JPEG.
    """
    steps = jpeg_quantization(content)
    if not steps:
        return None
    percent = 100 * sum(steps) / STANDARD_SUM
    return round(100 - percent / 2 if percent <= 100 else 5000 / percent)


def compression(images: DiveImages) -> DiveVerdict:
    """A first image that is compressed strongly."""
    with suppress(InputError):
        for pair in images.pairs[:1]:
            quality = jpeg_quality(read_image_bytes(pair.left))
            if quality is not None and quality < LEAST_QUALITY:
                note = (
                    f"input: {pair.left.name} is a JPEG of quality {quality}: dark and turbid "
                    "areas may show blocks of color; use the camera's original files, or "
                    "quality 90 and above"
                )
                return DiveVerdict((note,))
    return NOTHING_FOUND


def cut_out(images: DiveImages) -> DiveVerdict:
    """Metadata of the first or the middle pair that say that images were cut out or reshaped."""
    pairs = images.pairs
    for pair in dict.fromkeys((*pairs[:1], *pairs[len(pairs) // 2 :][:1])):
        for path in (pair.left, pair.right):
            with suppress(InputError, ValueError):  # damaged
                content = read_image_bytes(path)
                if how := framing(content, image_size(content)):
                    note = (
                        f"input: {path.name} {how}: ranges are correct only with a calibration "
                        "from images that were treated in the same way"
                    )
                    return DiveVerdict((note,))
    return NOTHING_FOUND
