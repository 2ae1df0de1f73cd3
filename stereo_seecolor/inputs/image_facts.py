"""The kind of image that a file holds, by its pixels: bits, color filter, brightness."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.camera_images import decode_raw
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.records import is_monochrome

BLOCK_PX, COLORS, TIMES_GREENS = 32, 0.04, 4.0
"""What is a Bayer mosaic, by medians over blocks of means of one place of the pattern, as a
fraction of their mean: by how much red or blue differs from green at least, and how many times as
much as the two greens from each other. Real frames as mosaics: 0.07 to 0.10 of a strobe-lit reef
(7 to 10 times the greens), 0.39 to 0.80 by daylight (30 and more); the same in gray: 0.001 to
0.007, through strong noise up to 0.06, never over 1.4 times.
"""


@dataclass(frozen=True)
class ImageFacts:
    """The kind of an image.

    size: (width, height). bits: a channel, of the file. used_bits: the fewest of 8, 10, 12, 14, 16
    that hold its values; 16 where all are even, which fewer bits are that were shifted. kind:
    "color", "monochrome", or "mosaic" (one channel with a Bayer pattern). bayer: the pattern,
    "none" for the others.
    """

    size: tuple[int, int]
    bits: int
    used_bits: int
    kind: str
    bayer: str = "none"


def image_facts(path: Path) -> ImageFacts:
    """Look at one image. Raises InputError if it cannot be read."""
    pixels = decode_raw(read_image_bytes(path), path, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    size, bits = (pixels.shape[1], pixels.shape[0]), 8 * pixels.dtype.itemsize
    if pixels.dtype.kind == "f":  # a range map, as a rule, with NaN in it
        return ImageFacts(size, bits, bits, "monochrome" if pixels.ndim == 2 else "color")
    highest = int(pixels.max(initial=0))
    shifted = highest > 0 and int(np.bitwise_or.reduce(pixels, axis=None)) & 1 == 0
    used = next((number for number in (8, 10, 12, 14) if highest < 1 << number and not shifted), 16)
    bayer = _pattern(pixels) if pixels.ndim == 2 else "none"
    kind = (
        "mosaic"
        if bayer != "none"
        else "monochrome"
        if pixels.ndim == 2 or is_monochrome(pixels)
        else "color"
    )
    return ImageFacts(size, bits, min(used, bits), kind, bayer)


def _pattern(pixels: NDArray[np.generic]) -> str:
    """The likeliest filter pattern, "none" for a gray image: two of the four places are alike, the
    greens, and others differ from them; water and sensors leave red darker than blue.
    """
    height, width = (size // 2 * 2 for size in pixels.shape)
    values = pixels[:height, :width].astype(np.float32)
    blocks = max(width // BLOCK_PX, 1), max(height // BLOCK_PX, 1)
    places = np.stack(
        [
            cv2.resize(values[y::2, x::2], blocks, interpolation=cv2.INTER_AREA)
            for y in (0, 1)
            for x in (0, 1)
        ]
    )
    a, b, c, d = places / np.maximum(places.mean(axis=0), 1e-3)
    green_outside = np.median(np.abs(b - c)) < np.median(np.abs(a - d))
    greens, others = ((b, c), (a, d)) if green_outside else ((a, d), (b, c))
    apart = float(np.median(np.abs(greens[0] - greens[1])))
    colored = max(float(np.median(np.abs(other - (greens[0] + greens[1]) / 2))) for other in others)
    if colored < max(COLORS, TIMES_GREENS * apart):
        return "none"
    red_first = others[0].mean() < others[1].mean()
    return ("rggb" if red_first else "bggr") if green_outside else ("grbg" if red_first else "gbrg")
