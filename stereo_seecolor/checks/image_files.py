"""The image files of a dive, as far as their form tells: pages, palettes, compression,
parts of a picture.

Images that cannot be read are left out: the run names them.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.checks.sample import DiveImages, edge, evenly_spaced
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, DiveVerdict
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.image_marks import JPEG_SIGNATURE, PNG_SIGNATURE
from stereo_seecolor.inputs.capture import framing
from stereo_seecolor.inputs.headers import (
    TIFF_SIGNATURES,
    image_size,
    jpeg_segments,
    png_chunk,
    tiff_pages,
)
from stereo_seecolor.inputs.images import read_image, read_image_bytes
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import FrameRow, Image


@dataclass(frozen=True)
class OrderSettings:
    """Constants of the check.

    looked_at: pairs over the dive that are compared, each with the next.
    quantiles: of each channel of an image; step_px: between the pixels that are counted.
    dark: fraction of full scale that is added, since the noise of dark pixels is not color.
    apart, times: by how much the logarithms of two images' red and blue over green must differ at
    least, and how many times as much as with red and blue exchanged. Of neighbors and of every
    fifth frame of a real reef, FLSea and the sample dive: at most 0.3 times as given, 3.6 and more
    exchanged; nearly gray images at most 1.1 times.
    """

    looked_at: int = 5
    quantiles: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)
    step_px: int = 4
    dark: float = 0.015
    apart: float = 0.05
    times: float = 2.0


SETTINGS = OrderSettings()
Colors = NDArray[np.float64]
"""(3, quantiles) logarithms of the values of R, G, B."""


def channel_order(images: DiveImages) -> DiveVerdict:
    """The left images of which red and blue are exchanged against those before, the first and the
    last.

    Of a single image other causes are as likely (another camera, light or scene), so that its
    colors alone are named.
    """
    pairs, config = images.pairs, images.config.input
    looked_at = evenly_spaced(range(len(pairs)), SETTINGS.looked_at)
    with suppress(InputError):
        before = _colors(pairs[0], config) if pairs else None
        for first, last in pairwise(looked_at):
            after = _colors(pairs[last], config)
            if before is not None and _are_exchanged(before, after):
                place = edge(first, last, _differs_from(first, pairs, config))
                end = _last_exchanged(pairs, place, last, looked_at, config)
                note = f"input: {_exchanged_text(pairs, place, end)}"
                return DiveVerdict((note,), COLORS if end > place else frozenset())
            before = after
    return NOTHING_FOUND


def _exchanged_text(pairs: Sequence[Pair], first: int, last: int) -> str:
    name = pairs[first].left.name
    if first == last:
        return (
            f"{name}: its red and blue do not fit the images before and after, and would if they "
            "were exchanged: it may hold them in each other's place, or be of another camera, "
            "light or scene: look at it, and leave it out or bring it to the others' order"
        )
    which = (
        f"{name} and what follows"
        if last == len(pairs) - 1
        else f"{name} to {pairs[last].left.name}"
    )
    return (
        f"{which} ({counted(last - first + 1, 'image')}) hold red and blue in each other's place, "
        f"compared with {pairs[first - 1].left.name} and before: bring all files to one order, or "
        "run the parts apart, that one with --set input.channels=bgr"
    )


def _last_exchanged(
    pairs: Sequence[Pair], place: int, seen: int, looked_at: Sequence[int], config: InputConfig
) -> int:
    """The last image in a row that is exchanged as the one at ``place`` is. seen: one that is known
    to be; looked_at: the places that are compared with it.
    """
    end = len(pairs)
    for later in (one for one in (*looked_at, len(pairs) - 1) if one > seen):
        if _are_exchanged(_colors(pairs[seen], config), _colors(pairs[later], config)):
            end = later
            break
        seen = later
    return edge(seen, end, _differs_from(seen, pairs, config)) - 1


def _differs_from(place: int, pairs: Sequence[Pair], config: InputConfig) -> Callable[[int], bool]:
    """Whether the image at another place is exchanged against the one here."""
    here = _colors(pairs[place], config)
    return lambda other: _are_exchanged(here, _colors(pairs[other], config))


def _colors(pair: Pair, config: InputConfig) -> Colors:
    image = read_image(pair.left, config)[:: SETTINGS.step_px, :: SETTINGS.step_px]
    values = np.quantile(image.reshape(-1, 3), SETTINGS.quantiles, axis=0).T
    return np.log(values / np.iinfo(image.dtype).max + SETTINGS.dark)


def _are_exchanged(one: Colors, other: Colors) -> bool:
    given, exchanged = _apart(one, other), _apart(one, other[::-1])
    return given > max(SETTINGS.apart, SETTINGS.times * exchanged)


def _apart(one: Colors, other: Colors) -> float:
    """How much red and blue over green differ between two images."""
    off = one - other
    return float(np.abs(off[[0, 2]] - off[1]).mean())


# Sides of which one holds no color, and files whose mosaic of colors was read one column or row
# off.

LOOKED_AT = 3
"""Pairs over the dive that are looked at for both."""
GRAY = 0.01
"""Of full scale: median difference of the channels of a side without color. JPEGs of gray images
have less, the dullest underwater frames (a real survey at 2 m in turbid water) 0.03."""
BLOCK_PX = 16
"""Side of the blocks that are compared: noise averages out, and color does not."""
ALIKE_GREEN = 0.3
"""Red against blue over the less of red and blue against green, medians of blocks. Demosaiced one
column or row off, red and blue both hold what green pixels saw: 0.00 to 0.27 of four dives; else
2.0 to 24."""
LATTICE = 0.02
"""Difference of even and odd rows, and of columns, of green, over its mean: as green then holds red
and blue in turn, 0.15 to 0.45 of three colored dives; else at most 0.003."""


def gray_side(images: DiveImages) -> DiveVerdict:
    """Left images without color beside right ones with it: true color is that of left images."""
    looked_at = evenly_spaced(images.pairs, LOOKED_AT)
    for pair in looked_at:
        with suppress(InputError):
            config = images.config.input
            if _has_color(pair.left, config) or not _has_color(pair.right, config):
                return NOTHING_FOUND
    if not looked_at:
        return NOTHING_FOUND
    note = (
        f"input: the left images hold no color and the right ones do ({looked_at[0].left.name}): "
        "true color is made of the left images, so that results are gray; ranges do not depend on "
        "it: exchange --left and --right, and the cameras in the calibration with them, or give "
        "left images in color"
    )
    return DiveVerdict((note,), COLORS)


def _has_color(path: Path, config: InputConfig) -> bool:
    image = read_image(path, config)
    some = image[:: SETTINGS.step_px, :: SETTINGS.step_px].astype(np.float64)
    return bool(np.median(np.ptp(some, axis=2)) > GRAY * np.iinfo(image.dtype).max)


def shifted_mosaic(images: DiveImages) -> DiveVerdict:
    """Files whose mosaic of colors was read one column or row off, on either side: true color is
    that of left images.
    """
    for side in ("left", "right"):
        with suppress(InputError):
            looked_at = evenly_spaced(images.pairs, LOOKED_AT)
            if looked_at and all(
                _is_off_by_one(read_image(getattr(pair, side), images.config.input))
                for pair in looked_at
            ):
                name = getattr(images.pairs[0], side).name
                note = (
                    f"input: {side} images ({name}): red and blue are equal and green holds a "
                    "lattice of rows and columns, as if a color mosaic (Bayer) was read one "
                    "column or row off: exchanged channels or another light leave no lattice: "
                    "convert the raw files again with the pattern shifted by one column (RGGB as "
                    "GRBG), or for raw mosaics --set input.bayer=..."
                )
                return DiveVerdict((note,), COLORS if side == "left" else frozenset())
    return NOTHING_FOUND


def _is_off_by_one(image: Image) -> bool:
    rows, columns = (length // BLOCK_PX for length in image.shape[:2])
    if not rows or not columns:
        return False
    blocks = image[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float64)
    blocks = blocks.reshape(rows, BLOCK_PX, columns, BLOCK_PX, 3)
    red, green, blue = np.moveaxis(blocks.mean(axis=(1, 3)), 2, 0)
    apart = min(np.median(np.abs(red - green)), np.median(np.abs(blue - green)))
    if np.median(np.abs(red - blue)) >= ALIKE_GREEN * apart:
        return False
    for axis in (1, 3):
        lines = np.moveaxis(blocks[..., 1], axis, 0)
        uneven = lines[::2].mean(axis=(0, 2)) - lines[1::2].mean(axis=(0, 2))
        if np.median(np.abs(uneven)) < LATTICE * np.median(green):
            return False
    return True


# Images that a dive holds twice in a row, because a camera stalled or files were copied.

BOTH = (
    "both images are those of the pair before: the cameras stalled, or files were copied, and "
    "their reef counts twice"
)
ONE = (
    "the {} image is that of the pair before, and the other is not: a camera stalled, and "
    "ranges are wrong by the motion since"
)


class RepeatedImages:
    """Compares each pair of a dive, by the hashes of its files, with the one before it whose files
    were read.
    """

    def __init__(self) -> None:
        self._before: Mapping[str, str] = {}

    def warning(self, row: FrameRow) -> str:
        """A warning if images of this pair are those of the pair before; else ""."""
        again = [
            side
            for side in ("left", "right")
            if side in row.hashes and row.hashes[side] == self._before.get(side)
        ]
        self._before = row.hashes or self._before
        if not again:
            return ""
        return BOTH if len(again) == 2 else ONE.format(again[0])


PALETTE = 3
"""Color type of a PNG (its specification, 11.2.2)."""


def form(images: DiveImages) -> DiveVerdict:
    """Pages or a palette in the files of the left images."""
    for pair in images.pairs[:1]:
        with suppress(InputError):
            content = read_image_bytes(pair.left)
            if content.startswith(TIFF_SIGNATURES) and (pages := tiff_pages(content)) > 1:
                note = (
                    f"input: {pair.left.name} holds {pages} pages, of which the first is read: "
                    "save each as a file of its own"
                )
                return DiveVerdict((note,))
            if content.startswith(PNG_SIGNATURE) and _has_palette_of_colors(content):
                rounded = (
                    f"has a palette of {len(png_chunk(content, b'PLTE')) // 3} colors, to "
                    "which its own were rounded"
                )
                note = (
                    f"input: {pair.left.name} {rounded}: colors come out wrong; take the "
                    "camera's own files"
                )
                return DiveVerdict((note,), COLORS)
    return NOTHING_FOUND


def _has_palette_of_colors(content: bytes) -> bool:
    palette = png_chunk(content, b"PLTE")
    return content[25] == PALETTE and palette[::3] != palette[1::3]


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


def compression(images: DiveImages) -> DiveVerdict:
    """A first image that is compressed strongly."""
    with suppress(InputError):
        for pair in images.pairs[:1]:
            quality = jpeg_quality(read_image_bytes(pair.left))
            if quality is not None and quality < LEAST_QUALITY:
                note = (
                    f"input: {pair.left.name} is a JPEG of quality {quality}: dark and turbid "
                    "places may come out in blocks of "
                    "color; take the camera's own files, or quality 90 and above"
                )
                return DiveVerdict((note,))
    return NOTHING_FOUND


# Pictures that are a part of the sensor's, enlarged or not: a calibration of the whole does not
# hold for them.


def cut_out(images: DiveImages) -> DiveVerdict:
    """Metadata of the first or the middle pair that say that pictures were cut out or zoomed."""
    pairs = images.pairs
    for pair in dict.fromkeys((*pairs[:1], *pairs[len(pairs) // 2 :][:1])):
        for path in (pair.left, pair.right):
            with suppress(InputError, ValueError):  # damaged
                content = read_image_bytes(path)
                if how := framing(content, image_size(content)):
                    note = (
                        f"input: {path.name} {how}: ranges are right only with a calibration "
                        "from pictures cut out and zoomed alike"
                    )
                    return DiveVerdict((note,))
    return NOTHING_FOUND
