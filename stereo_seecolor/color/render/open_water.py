"""Finds pixels of open water that matching assigned to the reef next to them."""

from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.render.carried import Smoother
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Image, Map, Mask
from stereo_seecolor.water.model import Water


@dataclass(frozen=True)
class OpenWater:
    """Conditions for open water: large areas of unknown range that are mostly uniform, and as
    bright as the backscatter at infinity.

    large: least fraction of the image; shadows of corals are smaller.
    wide_px: least width of an area, and largest distance of measured pixels that may show its
    water.
    contrast: largest standard deviation of its color, relative to its brightest channel; rock in
    shadow has 0.1.
    bright: least and greatest light over the backscatter at infinity, of each channel: 0.6 to 2.4
    for open water in four real frames; red of sand at 2 m is 6 to 7 times as bright.
    noise: least standard deviation, the noise of a camera, 8-bit values.
    stds: largest deviation of a pixel from its color, in standard deviations.
    """

    large: float = 0.02
    wide_px: int = 16
    contrast: float = 0.04
    bright: tuple[float, float] = (0.5, 3.0)
    noise: float = 2.0
    stds: float = 3.0


OPEN_WATER = OpenWater()


def without_open_water(image: Image, range_m: Map, water: Water, seen: Mask | None = None) -> Map:
    """Remove the ranges of pixels that show open water next to measured surfaces.

    Matching, and range maps of other programs, make objects in front of open water wider than they
    are. Corrected at the range of the reef, the water around them becomes blue.

    Args:
        image: (H, W, 3) RGB, uint8 or uint16.
        range_m: (H, W) float32, meters along the ray, NaN = unknown.
        water: The water to remove from the image.
        seen: As in ``carry_ranges``.

    Returns:
        (H, W) float32, meters; ``range_m`` itself if there are no such pixels.
    """
    known = np.isfinite(range_m)
    unknown = ~known if seen is None else ~known & seen
    step = Smoother.step_px
    size = (max(range_m.shape[1] // step, 1), max(range_m.shape[0] // step, 1))
    whole = cv2.resize(unknown.astype(np.float32), size, interpolation=cv2.INTER_AREA) == 1
    wide = OPEN_WATER.wide_px // step
    area = cv2.morphologyEx(whole.view(np.uint8), cv2.MORPH_OPEN, np.ones((wide, wide)))
    if np.count_nonzero(area) < OPEN_WATER.large * area.size:
        return range_m
    full = np.float32(255 / np.iinfo(image.dtype).max)
    colors = cv2.resize(image, size, interpolation=cv2.INTER_AREA) * full
    beside, mean, std = _water_beside(colors, area > 0, wide, water)
    if not beside.any():
        return range_m
    near = cv2.resize(beside, range_m.shape[::-1], interpolation=cv2.INTER_NEAREST)
    at = np.nonzero(near.view(bool) & known)
    cells = tuple(
        place * small // large
        for place, small, large in zip(at, beside.shape, range_m.shape, strict=True)
    )
    off = np.abs(image[at] * full - mean[cells])
    shown = (off <= OPEN_WATER.stds * np.maximum(std[cells], OPEN_WATER.noise)).all(axis=1)
    if not shown.any():
        return range_m
    out = range_m.copy()
    out[at[0][shown], at[1][shown]] = np.nan
    return out


def _water_beside(
    colors: NDArray[np.float32], area: Mask, reach: int, water: Water
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]]:
    """Where open water is within reach: (H, W) 1 or 0, and the mean and standard deviation of its
    color (H, W, 3), 8-bit values.
    """
    share = _around(area.astype(np.float32), reach)[..., None]
    sums = (_around(area[..., None] * each, reach) for each in (colors, colors**2))
    mean, square = (each / np.maximum(share, 1e-6) for each in sums)
    std = np.sqrt(np.maximum(square - mean**2, 0))
    darkest, brightest = (
        255 * (encode_srgb(veil) if water.input_encoding != "as-is" else veil)
        for veil in (np.minimum(factor * water.gamma_inf, 1.0) for factor in OPEN_WATER.bright)
    )
    of_std, of_mean = (reduce(cv2.max, cv2.split(each)) for each in (std, mean))
    even = of_std <= OPEN_WATER.contrast * of_mean  # of the largest channel
    found = even & (cv2.inRange(mean, darkest, brightest) > 0)
    near = cv2.dilate(_large(area, found), np.ones((2 * reach + 1, 2 * reach + 1)))
    beside = np.asarray((near > 0) & found & (share[..., 0] > 0), np.uint8)
    return beside, np.asarray(mean, np.float32), np.asarray(std, np.float32)


def _large(areas: Mask, chosen: Mask) -> NDArray[np.uint8]:
    """1 in the large connected areas of which the greater part is chosen."""
    _, labels = cv2.connectedComponents(areas.view(np.uint8))
    count = np.bincount(labels[areas], minlength=int(labels.max()) + 1)
    most = 2 * np.bincount(labels[areas & chosen], minlength=len(count)) > count
    found = most & (count >= OPEN_WATER.large * areas.size)
    return np.asarray(areas & found[labels], np.uint8)


def _around(values: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Means within some pixels to each side; what lies beyond the image counts as 0."""
    side = (2 * reach + 1, 2 * reach + 1)
    return np.asarray(cv2.boxFilter(values, -1, side, borderType=cv2.BORDER_CONSTANT))
