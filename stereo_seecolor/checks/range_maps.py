"""Range maps that hold disparities or inverse depths, in which the larger value is the nearer one.

Water takes red from what is far, and its haze takes contrast. Both are tested: in brown water,
which takes red least, and in files with red and blue exchanged, the far is redder too, but it
still has less contrast.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.blocks import in_blocks
from stereo_seecolor.checks.sample import DiveImages, evenly_spaced
from stereo_seecolor.checks.verdict import COLORS, NOTHING_FOUND, RANGES, DiveVerdict
from stereo_seecolor.color.table.encoding import decoded_values
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Array, Image

LOOKED_AT = 6
"""Images, spread over the folder, that are compared with their maps."""
BLOCK_PX = 16
"""Side of the blocks whose color and contrast are compared: a texture shows some periods in it."""
KNOWN = 0.9
"""Fraction of a block whose value must be known."""
LEAST_BLOCKS = 100
REDDER, CLEARER = 0.1, 0.0
"""Rank correlations of values with the blocks' red over green and blue, and with their contrast;
both must be larger, on average over the images. With true ranges (8 frames of FLSea, Sea-thru, 2 of
a jetty, 5 of a strobe-lit reef, 4 synthetic ones) the first is -0.96 to -0.03 and the second -0.66
to 0.05 in each single frame; the same maps as disparities have these with the other sign.
"""
TURNED = 0.15
"""A map turned back must correlate more by this than one read as disparities."""
_TURNS = {"upside down": (-1, 1), "mirrored": (1, -1), "turned by 180 degrees": (-1, -1)}
"""Steps through rows and columns."""
DARK = 0.002
"""Of full scale, added to light: the noise of dark pixels is no color."""
FIXED_POINT = 16
"""Steps of a pixel in which matchers store disparities (OpenCV)."""
MILLIMETERS_IN_M = 1000.0
LEAST_VALUES = 30
"""Different values of a map that tell in which steps it is stored."""
TINY = 1e-9
"""Differences that rounding leaves, in the color of gray images."""
ROUNDING = 1e-3
"""Of a step, by which values read as float32 may be off it."""


@dataclass(frozen=True)
class _RankCorrelations:
    """An image beside its map. redder, clearer: rank correlations of the map's values with red
    over green and blue and with contrast; NaN where too little is known. in_steps: the values are
    whole numbers of steps that no range is stored in.
    """

    redder: float
    clearer: float
    in_steps: bool


def disparities(images: DiveImages) -> DiveVerdict:
    """Range maps, the second files of pairs, in which the larger value is the nearer one."""
    seen = _looked_at(images)
    if not seen:
        return NOTHING_FOUND
    redder, clearer = (
        float(np.nanmean(values)) if np.isfinite(values).any() else 0.0
        for values in np.array([(one.redder, one.clearer) for one in seen]).T
    )
    in_steps = all(one.in_steps for one in seen)
    by_water = redder > REDDER and clearer > CLEARER
    if not (by_water or (in_steps and redder > -REDDER)):
        return NOTHING_FOUND
    name = images.pairs[0].right.name
    right = _turned_back(images) if by_water else {}
    how = min(right, key=lambda one: right[one], default="")
    if how and -right[how] > redder + TURNED:
        return DiveVerdict(
            (
                f"range: {name} is {how} relative to its image: turned back, its ranges have a "
                f"rank correlation of {right[how]:+.2f} with the redness of the image, as water "
                f"makes it, and {redder:+.2f} as it is; as disparities they would have "
                f"{-redder:+.2f}: turn the maps",
            ),
            RANGES | COLORS,
        )
    evidence = (
        f"where its values are larger, images are redder (rank correlation {redder:+.2f}) and have "
        f"more contrast ({clearer:+.2f}), but water reduces both with distance"
        if by_water
        else f"all its values are whole numbers of 1/{FIXED_POINT} of a pixel, or of "
        f"{FIXED_POINT} units"
    )
    alike = how and -right[how] > redder - TURNED
    rest = f"or, as likely, ranges {how}" if alike else "not ranges"
    return DiveVerdict(
        (
            f"range: {name} holds disparities or inverse depth, {rest}: {evidence}: "
            "convert it first: range along the axis = focal length in pixels x baseline / "
            f"disparity in pixels (in 16-bit files often the value / {FIXED_POINT} or / 256)",
        ),
        RANGES | COLORS,
    )


def _looked_at(images: DiveImages, turn: tuple[int, int] = (1, 1)) -> list[_RankCorrelations]:
    """Images spread over the dive beside their maps. turn: steps through rows and columns."""
    seen = []
    for pair in evenly_spaced(images.pairs, LOOKED_AT):
        with suppress(InputError):  # the run names it
            image = read_image(pair.left, images.config.input)
            values = read_range_map(pair.right, images.config.input.range_units_per_m)
            if values.shape == image.shape[:2]:
                turned = values[:: turn[0], :: turn[1]].astype(np.float64)
                seen.append(_compared(image, turned, images))
    return seen


def _turned_back(images: DiveImages) -> dict[str, float]:
    """Rank correlation with redness of maps turned back from each turn that is known for one."""
    redder = {
        how: np.array([one.redder for one in _looked_at(images, turn)])
        for how, turn in _TURNS.items()
    }
    return {
        how: float(np.nanmean(found)) for how, found in redder.items() if np.isfinite(found).any()
    }


def _compared(image: Image, values: Array, images: DiveImages) -> _RankCorrelations:
    known = np.isfinite(values)
    blocks = _blocks(known.astype(np.float64))
    use = blocks.mean(axis=-1) > KNOWN
    if use.sum() < LEAST_BLOCKS or image.ndim < 3:
        return _RankCorrelations(np.nan, np.nan, _is_in_steps(values[known]))
    decoded = decoded_values(8 * image.dtype.itemsize, images.config.color.encoding)
    light = decoded.astype(np.float64)[image] + DARK
    red, green, blue = (_blocks(light[..., channel])[use] for channel in range(3))
    value = np.nanmedian(_blocks(np.where(known, values, np.nan))[use], axis=-1)
    redness = red.mean(axis=-1) / (green.mean(axis=-1) + blue.mean(axis=-1))
    contrast = green.std(axis=-1) / green.mean(axis=-1)
    return _RankCorrelations(
        _rank_correlation(value, redness),
        _rank_correlation(value, contrast),
        _is_in_steps(values[known]),
    )


def _blocks(values: Array) -> Array:
    """(rows, columns, n) the pixels of each block of (H, W)."""
    blocks = in_blocks(values, BLOCK_PX).swapaxes(1, 2)
    return blocks.reshape(*blocks.shape[:2], BLOCK_PX**2)


def _rank_correlation(one: Array, other: Array) -> float:
    """Spearman's; NaN where one of both does not change."""
    if min(np.ptp(one), np.ptp(other)) < TINY:
        return float("nan")
    return float(np.corrcoef([values.argsort().argsort() for values in (one, other)])[0, 1])


def _is_in_steps(values: Array) -> bool:
    """Tell whether all are whole numbers of 1/16, but not all whole, or of 16 thousandths, which
    are read as millimeters.
    """
    sixteenths = values * FIXED_POINT
    if len(np.unique(values)) < LEAST_VALUES:
        return False
    return (_are_whole(sixteenths) and not _are_whole(values)) or _are_whole(
        values * MILLIMETERS_IN_M / FIXED_POINT
    )


def _are_whole(values: Array) -> bool:
    return bool((np.abs(values - np.round(values)) < ROUNDING).all())
