"""Checks for left images without color, and for Bayer mosaics read one column or row off."""

from contextlib import suppress
from pathlib import Path

import numpy as np

from stereo_seecolor.checks.channel_order import SETTINGS
from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, DiveVerdict
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import Image

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
    """Left images without color, as are their corrected ones; wrong if right ones have it."""
    looked_at, of_right = evenly_spaced(images.pairs, LOOKED_AT), []
    for pair in looked_at:
        with suppress(InputError):
            if _has_color(pair.left, images.config.input):
                return NOTHING_FOUND
            of_right.append(_has_color(pair.right, images.config.input))
    if not of_right:
        return NOTHING_FOUND
    which = f"input: the left images have no color ({looked_at[0].left.name})"
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
                    f"input: {side} images ({name}): red and blue are equal and green has a "
                    "pattern of rows and columns, as if a Bayer mosaic was read one column "
                    "or row off: convert the raw files again with the pattern shifted by one "
                    "column (RGGB as GRBG), or for raw mosaics --set input.bayer=..."
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
