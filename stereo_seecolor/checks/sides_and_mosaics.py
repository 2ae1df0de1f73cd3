"""Checks for left images without color, and for Bayer mosaics read one column or row off."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.checks.sample import SIDES_OF, DiveImages, ends_of_part, evenly_spaced
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, DiveVerdict
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import Array, Image

GRAY = 0.01
"""Of full scale: median difference of the channels of a side without color. JPEGs of gray images
have less, the dullest underwater frames (a real survey at 2 m in turbid water) 0.03."""
DARK, CLIPPED = 0.08, 0.98
"""Of full scale: images do not show their color if the median of the brightest channel is darker,
or that of the darkest one is brighter."""
TINTED = 0.01
"""The same with each channel divided by its mean, and half of what the other side must have: gray
images that were given a tint (JPEGs up to 0.01). Frames of turbid water have little more (a real
one 0.02), but so have both sides."""
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
    """Left images without color, whose corrected images have none; wrong beside right ones, or
    others of the left side, with it.
    """
    pairs = images.pairs
    looked_at: list[int] = []
    of_left, of_right, tinted = [], [], []
    for place in evenly_spaced(range(len(pairs)), SIDES_OF):
        with suppress(InputError):
            pixels = _some_pixels(images, pairs[place].left)
            darkest, brightest = np.median([pixels.min(axis=1), pixels.max(axis=1)], axis=1)
            if brightest < DARK or darkest > CLIPPED:
                continue
            left = _differ(pixels)
            right = left or _has_color(images, pairs[place].right)
            tinted.append(left and _is_tinted_gray(pixels, images, pairs[place].right))
            of_left.append(left)
            of_right.append(right)
            looked_at.append(place)
    is_tinted = all(tinted)
    if not looked_at or (all(of_left) and not is_tinted):
        return NOTHING_FOUND
    if any(of_left) and not is_tinted:
        return DiveVerdict((f"input: {_gray_part(images, looked_at, of_left)}",), COLORS)
    which = f"input: the left images have no color ({pairs[looked_at[0]].left.name})"
    if not all(of_right):
        return DiveVerdict(
            (f"{which}: corrected images are gray, and have the water of green light",)
        )
    note = (
        f"{which}, but the right ones do: results have the colors of the left images, so they are "
        "gray; ranges do not depend on it: exchange --left and --right, and the cameras in "
        "the calibration with them, or give left images in color"
    )
    return DiveVerdict((note,), COLORS)


def _gray_part(images: DiveImages, looked_at: Sequence[int], of_left: Sequence[bool]) -> str:
    """The first and last of the left images without color, as far as they were looked at."""
    pairs = images.pairs
    grays = [place for place, colored in zip(looked_at, of_left, strict=True) if not colored]
    first, last = ends_of_part(
        looked_at, grays, lambda place: not _has_color(images, pairs[place].left)
    )
    return (
        f"the left images have no color from {pairs[first].left.name} to {pairs[last].left.name}, "
        "others of the dive do: results have the colors of the left images, so they are gray "
        "there, and the dive's water and light are fitted to both: give the images in color, or "
        "process both parts separately"
    )


def _has_color(images: DiveImages, path: Path) -> bool:
    return _differ(_some_pixels(images, path))


def _differ(pixels: Array) -> bool:
    return bool(np.median(np.ptp(pixels, axis=1)) > GRAY)


def _is_tinted_gray(left: Array, images: DiveImages, right: Path) -> bool:
    """Tell whether the channels of the left image (n, 3) differ by a factor alone, and not those of
    the right one.
    """
    return _apart(left) <= TINTED and _apart(_some_pixels(images, right)) >= 2 * TINTED


def _apart(pixels: Array) -> float:
    """Median difference of the channels, each divided by its mean."""
    means = np.maximum(pixels.mean(axis=0), TINTED)
    return float(np.median(np.ptp(pixels * means.mean() / means, axis=1)))


def _some_pixels(images: DiveImages, path: Path) -> Array:
    """(n, 3) of full scale."""
    image = images.thinned(path)
    return image.reshape(-1, 3) / np.iinfo(image.dtype).max


def shifted_mosaic(images: DiveImages) -> DiveVerdict:
    """Files of left images whose mosaic of colors was read one column or row off."""
    for side in ("left", "right"):
        with suppress(InputError):
            looked_at = evenly_spaced(images.pairs, SIDES_OF)
            if looked_at and all(
                _is_off_by_one(read_image(getattr(pair, side), images.config.input))
                for pair in looked_at
            ):
                name = getattr(images.pairs[0], side).name
                note = (
                    f"input: {side} images ({name}): red and blue are equal and green has a "
                    "pattern of rows and columns, as if a Bayer mosaic was read one column "
                    "or row off: convert the raw files again with the pattern shifted by one "
                    "column (RGGB as GRBG), or for raw mosaics set another input.bayer"
                )
                return DiveVerdict((note,), COLORS if side == "left" else frozenset())
    return NOTHING_FOUND


def _is_off_by_one(image: Image) -> bool:
    blocks = in_blocks(image, BLOCK_PX).astype(np.float64)
    if not blocks.size:
        return False
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
