"""What the form of a dive's image files says of their pictures: more pages than one, a palette, linear light."""

from collections.abc import Sequence
from contextlib import suppress
from statistics import median

from stereo_seecolor.config import ColorConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.headers import JPEG_SIGNATURE, PNG_SIGNATURE, TIFF_SIGNATURES, png_chunk, tiff_pages
from stereo_seecolor.inputs.image_facts import image_facts
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.pairing import Pair

PALETTE = 3
"""Color type of a PNG (its specification, 11.2.2)."""
LINEAR = (100_000).to_bytes(4, "big")
"""Content of the chunk gAMA of a PNG that says that its values are linear light."""
DARK_MEDIAN = 0.1
"""Of 8-bit images: median of the brightest channel over its brightest thousandth, of three frames. Encoded for a screen: 0.18 to
0.6 in real frames; as linear light 0.08 of two of five dives (FLSea, a strobe-lit reef), 0.25 and more of the others.
"""
FEW = 3


def form_notes(pairs: Sequence[Pair], color: ColorConfig) -> tuple[str, ...]:
    """What to say of the files of a dive's left images; nothing of those that cannot be read, which the run names."""
    for pair in pairs[:1]:
        with suppress(InputError):
            content = read_image_bytes(pair.left)
            if content.startswith(TIFF_SIGNATURES) and (pages := tiff_pages(content)) > 1:
                return (f"input: {pair.left.name} holds {pages} pages, of which the first is read: save each as a file of its own",)
            if content.startswith(PNG_SIGNATURE) and _has_palette_of_colors(content):
                rounded = f"has a palette of {len(png_chunk(content, b'PLTE')) // 3} colors, to which its own were rounded"
                return (f"input: {pair.left.name} {rounded}: colors come out wrong; take the camera's own files",)
            return () if content.startswith(JPEG_SIGNATURE) else _linear_notes(pairs, content, color)
    return ()


def _has_palette_of_colors(content: bytes) -> bool:
    palette = png_chunk(content, b"PLTE")
    return content[25] == PALETTE and palette[::3] != palette[1::3]


def _linear_notes(pairs: Sequence[Pair], content: bytes, color: ColorConfig) -> tuple[str, ...]:
    """Warn where 8-bit files say, or look as if, they hold linear light, and are read as encoded."""
    if color.input_encoding != "srgb":
        return ()
    advice = "--set color.input_encoding=linear; 8 bits of linear light leave dark places a few values"
    if content.startswith(PNG_SIGNATURE) and png_chunk(content, b"gAMA") == LINEAR:
        return (f"color: {pairs[0].left.name} says that it holds linear light (gAMA 1), and is read as encoded: {advice}",)
    with suppress(InputError):
        facts = [image_facts(pair.left) for pair in pairs[:: max(1, len(pairs) // FEW)][:FEW]]
        if all(one.bits == 8 for one in facts) and median(one.middle for one in facts) < DARK_MEDIAN:
            return (f"color: {pairs[0].left.name} is dark for an image encoded for a screen: if it holds linear light: {advice}",)
    return ()
