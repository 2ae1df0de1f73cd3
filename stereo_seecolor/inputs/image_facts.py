"""What kind of image a file holds, as far as its pixels tell."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.inputs.images import decode_raw, read_image_bytes
from stereo_seecolor.records import is_monochrome

MOSAIC_RATIO = 1.5
"""Neighboring pixels of a Bayer mosaic differ by more than those of one color two apart; in a gray image they differ by less."""


@dataclass(frozen=True)
class ImageFacts:
    """size: (width, height). bits: a channel, of the file. used_bits: the fewest of 8, 10, 12, 14, 16 that hold its values.

    kind: "color", "monochrome", or "mosaic" (one channel with a Bayer pattern). bayer: the pattern, "none" for the others.
    middle: median of the brightest channel over its brightest thousandth.
    """

    size: tuple[int, int]
    bits: int
    used_bits: int
    kind: str
    bayer: str = "none"
    middle: float = 1.0


def image_facts(path: Path) -> ImageFacts:
    """Look at one image. Raises InputError if it cannot be read."""
    pixels = decode_raw(read_image_bytes(path), path, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    highest = int(pixels.max(initial=0))
    bits = 8 * pixels.dtype.itemsize
    used = next((number for number in (8, 10, 12, 14) if highest < 1 << number), 16)
    kind = _kind(pixels)
    bayer = _pattern(pixels) if kind == "mosaic" else "none"
    return ImageFacts((pixels.shape[1], pixels.shape[0]), bits, min(used, bits), kind, bayer, _middle(pixels, kind))


def _middle(pixels: NDArray[np.generic], kind: str) -> float:
    if kind == "mosaic":
        height, width = (size // 2 * 2 for size in pixels.shape)
        pixels = np.dstack([pixels[y:height:2, x:width:2] for y in (0, 1) for x in (0, 1)])
    sample = pixels[::4, ::4]
    median, full = np.quantile(sample if sample.ndim == 2 else sample.max(axis=2), (0.5, 0.999))
    return float(median / full) if full else 1.0


def _kind(pixels: NDArray[np.generic]) -> str:
    if pixels.ndim == 3:
        return "monochrome" if is_monochrome(pixels) else "color"
    values = pixels.astype(np.float32)
    next_to_it, two_apart = (float(np.abs(values[:, step:] - values[:, :-step]).mean()) for step in (1, 2))
    return "mosaic" if next_to_it > MOSAIC_RATIO * two_apart else "monochrome"


def _pattern(mosaic: NDArray[np.generic]) -> str:
    """The likeliest filter pattern: the two greens are alike, and water and sensors leave red darker than blue."""
    height, width = (size // 2 * 2 for size in mosaic.shape)
    values = mosaic[:height, :width].astype(np.float32)
    a, b, c, d = values[::2, ::2], values[::2, 1::2], values[1::2, ::2], values[1::2, 1::2]
    if np.abs(b - c).mean() < np.abs(a - d).mean():
        return "rggb" if a.mean() < d.mean() else "bggr"
    return "grbg" if b.mean() < c.mean() else "gbrg"
