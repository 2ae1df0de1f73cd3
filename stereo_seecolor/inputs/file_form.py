"""The form of a dive's image files: pages, palettes, stored bits, compression, linear light."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median, mode
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import ColorConfig, InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.capture import framing
from stereo_seecolor.inputs.decoding import decode_raw
from stereo_seecolor.inputs.headers import (
    JPEG_SIGNATURE,
    PNG_SIGNATURE,
    TIFF_SIGNATURES,
    image_size,
    is_finished_color,
    jpeg_segments,
    png_chunk,
    tiff_pages,
)
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
    reef (7 to 10 times the greens), 0.39 to 0.80 by daylight
    (30 and more); the same in gray: 0.001 to 0.007, through strong noise up to 0.06, never over 1.4
    times.
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


# What the form of a dive's image files says of their pictures: more pages than one, a palette,
# linear light.

PALETTE = 3
"""Color type of a PNG (its specification, 11.2.2)."""
LINEAR = (100_000).to_bytes(4, "big")
"""Content of the chunk gAMA of a PNG that says that its values are linear light."""
FILE_FORM_DARK_MEDIAN = 0.1
"""Of 8-bit images: median of the brightest channel over its brightest thousandth, of three frames.
Encoded for a screen: 0.18 to
0.6 in real frames; as linear light 0.08 of two of five dives (FLSea, a strobe-lit reef), 0.25 and
more of the others.
"""
FEW = 3


def form_notes(pairs: Sequence[Pair], color: ColorConfig) -> tuple[str, ...]:
    """What to say of the files of a dive's left images; nothing of those that cannot be read, which
    the run names.
    """
    for pair in pairs[:1]:
        with suppress(InputError):
            content = read_image_bytes(pair.left)
            if content.startswith(TIFF_SIGNATURES) and (pages := tiff_pages(content)) > 1:
                return (
                    f"input: {pair.left.name} holds {pages} pages, of which the first is read: "
                    "save each as a file of its own",
                )
            if content.startswith(PNG_SIGNATURE) and _has_palette_of_colors(content):
                rounded = (
                    f"has a palette of {len(png_chunk(content, b'PLTE')) // 3} colors, to "
                    "which its own were rounded"
                )
                return (
                    f"input: {pair.left.name} {rounded}: colors come out wrong; take the "
                    "camera's own files",
                )
            return (
                () if content.startswith(JPEG_SIGNATURE) else _linear_notes(pairs, content, color)
            )
    return ()


def _has_palette_of_colors(content: bytes) -> bool:
    palette = png_chunk(content, b"PLTE")
    return content[25] == PALETTE and palette[::3] != palette[1::3]


def _linear_notes(pairs: Sequence[Pair], content: bytes, color: ColorConfig) -> tuple[str, ...]:
    """Warn where 8-bit files say, or look as if, they hold linear light, and are read as
    encoded.
    """
    if color.input_encoding != "srgb":
        return ()
    advice = (
        "--set color.input_encoding=linear; 8 bits of linear light leave dark places a few values"
    )
    if content.startswith(PNG_SIGNATURE) and png_chunk(content, b"gAMA") == LINEAR:
        return (
            f"color: {pairs[0].left.name} says that it holds linear light (gAMA 1), and is read "
            f"as encoded: {advice}",
        )
    with suppress(InputError):
        facts = [image_facts(pair.left) for pair in pairs[:: max(1, len(pairs) // FEW)][:FEW]]
        if (
            all(one.bits == 8 for one in facts)
            and median(one.middle for one in facts) < FILE_FORM_DARK_MEDIAN
        ):
            return (
                f"color: {pairs[0].left.name} is dark for an image encoded for a screen: if it "
                f"holds linear light: {advice}",
            )
    return ()


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
            "darker than blue: if colors come out "
            "exchanged, set input.bayer"
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


# JPEG images compressed so strongly that color is left in blocks: dark and turbid scenes come out
# in patches of red and green.

QUANTIZATION = 0xFFDB
"""Marker of the tables: of each, its precision and number, both 0 of that of luminance in 8 bits,
and 64 steps.
"""
STANDARD_SUM = 3688
"""Of the 64 steps of quantization of luminance that quality 50 has: ITU T.81, table K.1."""
LEAST_QUALITY = 80
"""On dark frames of FLSea quality 60 leaves clear blocks of color, 75 faint ones, 85 hardly any."""


def jpeg_quality(content: bytes) -> int | None:
    """1 to 100, as the Independent JPEG Group counts it, of a JPEG's quantization of luminance;
    None of what is not a JPEG.
    """
    if not content.startswith(JPEG_SIGNATURE):
        return None
    tables = b"".join(
        segment for marker, segment in jpeg_segments(content) if marker == QUANTIZATION
    )
    if len(tables) < 65 or tables[0] != 0:
        return None
    percent = 100 * sum(tables[1:65]) / STANDARD_SUM
    return round(100 - percent / 2 if percent <= 100 else 5000 / percent)


def compression_notes(pairs: Sequence[Pair]) -> tuple[str, ...]:
    """What to say of the compression of a dive's first image; nothing where it is weak, or the
    image cannot be read.
    """
    with suppress(InputError):  # the run names what cannot be read
        for pair in pairs[:1]:
            quality = jpeg_quality(read_image_bytes(pair.left))
            if quality is not None and quality < LEAST_QUALITY:
                return (
                    f"input: {pair.left.name} is a JPEG of quality {quality}: dark and turbid "
                    "places may come out in blocks of "
                    "color; take the camera's own files, or quality 90 and above",
                )
    return ()


# A warning about deep images that are read as encoded for a screen, but look as if they held
# linear light, as raw converters write it.

LINEAR_LOOK_DARK_MEDIAN = 0.2
"""Median of the brightest channel over its brightest thousandth. Encoded: 0.29 to 0.59 in frames of
a real reef, a Sea-thru scene and drawn dives by day and night; the same as linear light 0.07 to
0.31.
"""


def encoding_notes(config: ColorConfig, facts: Mapping[Path, ImageFacts]) -> tuple[str, ...]:
    """Warn where the first of a dive's images contradicts ``input_encoding: srgb``; nothing where
    it has 8 bits.
    """
    first = next(iter(facts), None)
    if (
        config.input_encoding != "srgb"
        or first is None
        or facts[first].bits <= 8
        or facts[first].middle >= LINEAR_LOOK_DARK_MEDIAN
    ):
        return ()
    doubt = f"color: {first.name} is dark for an image encoded for a screen, as which it is read"
    return (
        f"{doubt}: if it holds linear light, as from a raw converter: --set "
        "color.input_encoding=linear",
    )


# Pictures that are a part of the sensor's, enlarged or not: a calibration of the whole does not
# hold for them.


def framing_notes(pairs: Sequence[Pair]) -> tuple[str, ...]:
    """Warn where metadata of the first or the middle pair say that pictures were cut out or zoomed.

    Args:
        pairs: Of the dive; images that cannot be read are left out, which the run names.

    Returns:
        One line, or nothing.
    """
    for pair in dict.fromkeys((*pairs[:1], *pairs[len(pairs) // 2 :][:1])):
        for path in (pair.left, pair.right):
            with suppress(InputError, ValueError):  # damaged
                content = read_image_bytes(path)
                if how := framing(content, image_size(content)):
                    return (
                        f"input: {path.name} {how}: ranges are right only with a calibration "
                        "from pictures cut out and zoomed alike",
                    )
    return ()
