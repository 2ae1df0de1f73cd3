"""How a dive's image files store their pixels: bits, color filter pattern, brightness."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import mode
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.decoding import decode_raw
from stereo_seecolor.inputs.headers import is_finished_color
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import is_monochrome

# The kind of image that a file holds, as far as its pixels tell.


@dataclass(frozen=True)
class MosaicLimits:
    """Decides what is a Bayer mosaic, by medians over blocks of means of one place of the pattern,
    as a fraction of their mean.

    colors, times_greens: by how much red or blue differs from green at least, and how many times as
    much as the two greens from each other. Real frames as mosaics: 0.07 to 0.10 of a strobe-lit
    reef (7 to 10 times the greens), 0.39 to 0.80 by daylight (30 and more); the same in gray: 0.001
    to 0.007, through strong noise up to 0.06, never over 1.4 times.
    """

    block_px: int = 32
    colors: float = 0.04
    times_greens: float = 4.0


LIMITS = MosaicLimits()


@dataclass(frozen=True)
class ImageFacts:
    """The kind of an image.

    size: (width, height). bits: a channel, of the file. used_bits: the fewest of 8, 10, 12, 14, 16
    that hold its values. kind: "color", "monochrome", or "mosaic" (one channel with a Bayer
    pattern). bayer: the pattern, "none" for the others. middle: median of the brightest channel
    over its brightest thousandth.
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
    bits = 8 * pixels.dtype.itemsize
    if pixels.dtype.kind == "f":  # a range map, as a rule, with NaN in it
        return ImageFacts(
            (pixels.shape[1], pixels.shape[0]),
            bits,
            bits,
            "monochrome" if pixels.ndim == 2 else "color",
        )
    highest = int(pixels.max(initial=0))
    used = next((number for number in (8, 10, 12, 14) if highest < 1 << number), 16)
    bayer = _pattern_image_facts(pixels) if pixels.ndim == 2 else "none"
    kind = (
        "mosaic"
        if bayer != "none"
        else "monochrome"
        if pixels.ndim == 2 or is_monochrome(pixels)
        else "color"
    )
    return ImageFacts(
        (pixels.shape[1], pixels.shape[0]),
        bits,
        min(used, bits),
        kind,
        bayer,
        _middle(pixels, kind),
    )


def _middle(pixels: NDArray[np.generic], kind: str) -> float:
    if kind == "mosaic":
        height, width = (size // 2 * 2 for size in pixels.shape)
        pixels = np.dstack([pixels[y:height:2, x:width:2] for y in (0, 1) for x in (0, 1)])
    sample = pixels[::4, ::4]
    median, full = np.quantile(sample if sample.ndim == 2 else sample.max(axis=2), (0.5, 0.999))
    return float(median / full) if full else 1.0


def _pattern_image_facts(pixels: NDArray[np.generic]) -> str:
    """The likeliest filter pattern, "none" for a gray image: two of the four places are alike, the
    greens, and others differ from them; water and sensors leave red darker than blue.
    """
    height, width = (size // 2 * 2 for size in pixels.shape)
    values = pixels[:height, :width].astype(np.float32)
    blocks = max(width // LIMITS.block_px, 1), max(height // LIMITS.block_px, 1)
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
    if colored < max(LIMITS.colors, LIMITS.times_greens * apart):
        return "none"
    red_first = others[0].mean() < others[1].mean()
    return ("rggb" if red_first else "bggr") if green_outside else ("grbg" if red_first else "gbrg")


# How a dive's images store their pixels: color filter patterns of raw cameras, and 10, 12 or 14
# bits unshifted.

UNSHIFTED: tuple[Literal[10, 12, 14], ...] = (10, 12, 14)
"""Bits of the sensors whose values lie at the lower end of 16-bit files."""


def stored_facts(config: InputConfig, sample: Sequence[Pair]) -> dict[Path, ImageFacts]:
    """Collect the facts of raw and of deep images, in their order; none where one is neither.

    One that cannot be read is left out, as is a monochrome one on the right of a raw one. sample:
    pairs from all parts of a dive; one of them is read where the settings say how images are
    stored.
    """
    if "auto" not in (config.significant_bits, config.bayer):
        sample = sample[:1]
    facts: dict[Path, ImageFacts] = {}
    for pair in sample:
        for path in (pair.left, pair.right):
            with suppress(InputError):  # the run names it
                if is_finished_color(read_image_bytes(path)):
                    return {}
                one = image_facts(path)
                if (
                    one.bayer == "none"
                    and path == pair.right
                    and pair.left in facts
                    and facts[pair.left].bayer != "none"
                ):
                    # a monochrome camera beside a raw one, which reading as raw hardly blurs
                    continue
                if one.bits < 16 and one.bayer == "none":
                    return {}
                facts[path] = one
    return facts


def as_stored(config: InputConfig, found: Mapping[Path, ImageFacts]) -> InputConfig:
    """Set ``significant_bits`` and ``bayer``, where they are "auto", to what the images have.
    found: by stored_facts.
    """
    facts = list(found.values())
    update: dict[str, object] = {}
    if config.significant_bits == "auto":
        update["significant_bits"] = _used_bits(facts)
    if config.bayer == "auto":
        update["bayer"] = _pattern_stored_pixels([one.bayer for one in facts])
    return config.model_copy(update=update)


def stored_notes(given: InputConfig, found: InputConfig) -> tuple[str, ...]:
    """Report the settings that were found."""
    notes = []
    if found.bayer != given.bayer and found.bayer != "none":
        notes.append(
            f"input: raw images with a color filter pattern, taken for {found.bayer}, red for "
            "darker than blue: if colors come out exchanged, set input.bayer"
        )
    if found.significant_bits != given.significant_bits and found.significant_bits is not None:
        notes.append(
            f"input: the 16-bit images hold {found.significant_bits} bits, which are scaled to full"
        )
    return tuple(notes)


def _pattern_stored_pixels(found: Sequence[str]) -> str:
    """What most images show, where all show one."""
    return mode(found) if found and "none" not in found else "none"


def _used_bits(facts: Iterable[ImageFacts]) -> Literal[None, 10, 12, 14]:
    most = max((one.used_bits for one in facts), default=0)
    return next((bits for bits in UNSHIFTED if bits == most), None)
