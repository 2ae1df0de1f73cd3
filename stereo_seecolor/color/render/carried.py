"""Ranges and colors where no range was measured: carried over from neighbors, and limited."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Image, Map, Mask
from stereo_seecolor.water.model import Water

# Ranges for pixels where none was measured, for color alone: carried over from measured neighbors
# of the same color.
#
#     range = S(w z + e r) / S(w + e),   w = z^2 where the range z is measured, 0 elsewhere
#
# S smooths along surfaces of one color and stops at edges (fast global smoother; Min et al. 2014,
# doi:10.1109/TIP.2014.2366600). It is taken three times, from far reach to near: r is the range
# by the reach before, so that the nearest measured ranges count most. What stereo does not see
# lies behind what hides it, so farther neighbors weigh more: the few that lie far from all
# others, which are wrong matches, are left out. Water changes color slowly with range, so a
# quarter of the resolution is enough.


@dataclass(frozen=True)
class Smoother:
    """step_px: the resolution, in pixels of the image. reaches: smoothness, far to near; on one
    color 1000 carries over some 30 steps, 10 over some 3, and 1 over one; each with its passes over
    rows and columns. One of 100 between them, or a single pass of 1000, draws bands into open
    water.

    color_sigma: difference of 8-bit values that counts as an edge: three times a camera's noise.
    farther: weight of what the reach before gave, against the mean one of what is measured; before
    the first reach that is the frame's median range.
    strays: fraction of a frame's ranges, nearest and farthest each, that are not carried: a dozen
    wrong pixels at four times the range of a real reef turned a spot of 80x90 pixels red.
    """

    step_px: int = 4
    reaches: tuple[tuple[float, int], ...] = ((1000.0, 2), (10.0, 1), (1.0, 1))
    color_sigma: float = 5.0
    farther: float = 0.01
    strays: float = 0.002


SAMPLE = 2
"""Quantiles are of every second row and column of the small maps: all take four times as long."""


def carry_ranges(
    image: Image, range_m: Map, seen: Mask | None = None, smoother: Smoother | None = None
) -> Map:
    """The range map with its unknown pixels filled; itself where nothing is known or missing.

    image: (H, W, 3) RGB uint8 or uint16. range_m: (H, W) float32 meters along the ray, NaN unknown.
    seen: (H, W) True where the image shows something; elsewhere the range stays unknown.
    """
    smoother = smoother or Smoother()
    known = np.isfinite(range_m)
    missing = ~known if seen is None else ~known & seen
    if not missing.any() or not known.any():
        return range_m
    height, width = range_m.shape
    small = _smoothed(image, range_m, known, smoother)
    carried = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.copyTo(carried, missing.view(np.uint8), range_m.copy()))


def _smoothed(image: Image, range_m: Map, known: Mask, smoother: Smoother) -> NDArray[np.float32]:
    """Measured and carried ranges at the smoother's resolution."""
    step = smoother.step_px
    height, width = range_m.shape
    fx, fy = max(1 / step, 1 / width), max(1 / step, 1 / height)  # one pixel at least
    guide = cv2.resize(image, None, fx=fx, fy=fy, interpolation=cv2.INTER_AREA)
    guide = guide if guide.dtype == np.uint8 else cv2.convertScaleAbs(guide, alpha=1 / 257)
    size = guide.shape[1::-1]
    mask = known.view(np.uint8)
    total = cv2.resize(cv2.copyTo(range_m, mask), size, interpolation=cv2.INTER_AREA)
    density = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mean_m = np.divide(total, density, out=np.zeros_like(total), where=density > 0)
    sample_m = mean_m[::SAMPLE, ::SAMPLE][density[::SAMPLE, ::SAMPLE] > 0]
    near_m, far_m = (
        np.quantile(sample_m, [smoother.strays, 1 - smoother.strays])
        if sample_m.size
        else (0.0, np.inf)
    )
    weight = density * mean_m**2 * ((mean_m >= near_m) & (mean_m <= far_m))
    farther = smoother.farther * float(weight.sum() / np.count_nonzero(density))
    carried = np.median(mean_m[density > 0])
    for reach, passes in smoother.reaches:
        smooth = cv2.ximgproc.createFastGlobalSmootherFilter(
            guide, reach, smoother.color_sigma, num_iter=passes
        )
        carried = smooth.filter(weight * mean_m + farther * carried) / smooth.filter(
            weight + farther
        )
    nearest_m, farthest_m, *_ = cv2.minMaxLoc(range_m, mask)
    return np.asarray(np.clip(carried, max(near_m, nearest_m), min(far_m, farthest_m)), np.float32)


@dataclass(frozen=True)
class OpenWater:
    """What is taken for open water: large areas of unknown range that are for the greater part
    even, and as bright as what the water scatters at infinity.

    large: least part of the picture; shadows of corals are smaller.
    wide_px: least width of an area, and how far beside it measured pixels may show its water.
    contrast: greatest standard deviation of its color, of its brightest channel; rock in shadow has
    0.1.
    bright: least and greatest light over the backscatter at infinity, of each channel: 0.6 to 2.4
    for open water in four real frames; red of sand at 2 m is 6 to 7 times as bright.
    noise: least standard deviation that is counted on, a camera's, 8-bit values.
    stds: how many a pixel of its color may be off.
    """

    large: float = 0.02
    wide_px: int = 16
    contrast: float = 0.04
    bright: tuple[float, float] = (0.5, 3.0)
    noise: float = 2.0
    stds: float = 3.0


OPEN_WATER = OpenWater()


def without_open_water(image: Image, range_m: Map, water: Water, seen: Mask | None = None) -> Map:
    """The range map without pixels that show the open water beside what was measured; itself where
    there are none.

    Matching, and range maps of other programs, make what stands before open water wider than it is.
    Corrected at the range of the reef, the water around it comes out blue. water: taken out of the
    image. Other parameters as of ``carry_ranges``.
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
    even = std.max(axis=2) <= OPEN_WATER.contrast * mean.max(axis=2)
    found = even & ((mean >= darkest) & (mean <= brightest)).all(axis=2)
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


# Limits colors where a range was carried over to those of measured pixels of the same image.
#
# Where the carried range is too large, too much backscatter is taken off, and red, of which water
# leaves least, gets far too much gain: rims and caves before open water come out red. Open water
# has no range at all: what it scatters is taken for a surface, cyan, blue, violet or pink. So
# where a range was carried over, no channel exceeds the greater of the other two by more than in
# nearly all that was measured, red falls below the lesser of the other two by no more than there,
# and green by no more than in half of it. Small holes are left as they are: their ranges lie
# between measured ones, and what is rare in an image, as a red sponge, stays red. So is the strip
# that the right camera does not see: it cannot be matched, whatever it shows.

RED, GREEN = 0, 1


@dataclass(frozen=True)
class BoundSettings:
    """Settings of the limits."""

    quantile: float = 0.97
    """Fraction of measured pixels within the bounds: wrong matches and the noise of far ones are a
    few percent. With 0.95, holes drawn into photographs under water come out 0.1 degrees worse;
    with 0.97 no open water that was looked at is red.
    """
    green: float = 0.5
    """Fraction of measured pixels with less green than carried ones may have: open water came out
    violet.
    """
    least_light: float = 0.007
    """Least linear light that is divided by: ratios of darker pixels are noise."""
    every_px: int = 8
    """Every so many rows and columns are examined."""
    hole_px: int = 15
    """Width of areas, pixels, from which carried colors are limited: holes are narrower."""
    fewest: int = 100
    """Least measured pixels for which bounds are set."""


SETTINGS = BoundSettings()


class Bounds(NamedTuple):
    """most (3,): of a channel over the greater of the other two. least (3,): over the lesser."""

    most: NDArray[np.float32]
    least: NDArray[np.float32]


def within_measured(image: NDArray[Any], carried: Mask, measured: Mask) -> NDArray[Any]:
    """The corrected image with colors limited to measured ones where the range was carried over.

    image: (H, W, 3) encoded uint8 or uint16, or float32 in linear light.
    """
    every = slice(None, None, SETTINGS.every_px), slice(None, None, SETTINGS.every_px)
    bounds = bounds_of(image[every], measured[every]) if carried.any() else None
    if bounds is None:
        return image
    at = np.flatnonzero(_wide(carried))
    full = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else np.inf
    pixels = np.maximum(image.reshape(-1, 3)[at].T.astype(np.float32, order="C"), 0)
    limited = pixels.copy()
    for c in range(3):
        a, b = _others(c)
        least = np.minimum(pixels[a], pixels[b]) * bounds.least[c]
        most = np.maximum(pixels[a], pixels[b]) * bounds.most[c]
        limited[c] = np.clip(pixels[c], least, np.minimum(most, full))
    changed = (limited != pixels).any(axis=0)
    out = image.copy()
    out.reshape(-1, 3)[at[changed]] = limited[:, changed].T
    return out


def _wide(carried: Mask) -> Mask:
    """(H, W) True in carried areas at least ``hole_px`` wide, and what joins them."""
    core = cv2.morphologyEx(
        carried.astype(np.uint8), cv2.MORPH_OPEN, np.ones((SETTINGS.hole_px,) * 2, np.uint8)
    )
    reach = cv2.dilate(core, np.ones((2 * SETTINGS.hole_px + 1,) * 2, np.uint8))
    return np.asarray(carried & (reach > 0))


def seen_by_both(carried: Mask, outside: Mask) -> Mask:
    """The carried areas but for those that lie outside the right image for the greater part.

    carried: (H, W) where the range was carried over. outside: (H, W) where the right image does not
    reach (``RectifiedPair.outside_right``).
    """
    wide = _wide(carried)
    _, labels = cv2.connectedComponents(wide.view(np.uint8))
    area, number = labels[wide], int(labels.max()) + 1
    most_outside = 2 * np.bincount(area[outside[wide]], minlength=number) > np.bincount(
        area, minlength=number
    )
    kept = carried.copy()
    kept[wide] = ~most_outside[area]
    return kept


def _others(c: int) -> list[int]:
    return [o for o in range(3) if o != c]


def bounds_of(image: NDArray[Any], measured: Mask) -> Bounds | None:
    """The bounds from measured pixels of these; None where there are too few."""
    encoded = np.issubdtype(image.dtype, np.integer)
    dark = (
        encode_srgb(np.array(SETTINGS.least_light)) * np.iinfo(image.dtype).max
        if encoded
        else SETTINGS.least_light
    )
    seen = image[measured].astype(np.float32)
    bounds = Bounds(np.full(3, np.inf, np.float32), np.zeros(3, np.float32))
    for c in range(3):
        others = seen[:, _others(c)]
        lit = (others > dark).all(axis=1)
        if np.count_nonzero(lit) < SETTINGS.fewest:
            return None
        own, others = seen[lit, c], others[lit]
        # gray is always within the bounds
        bounds.most[c] = max(np.quantile(own / others.max(axis=1), SETTINGS.quantile), 1.0)
        if c in (RED, GREEN):
            shorter = 1 - SETTINGS.quantile if c == RED else SETTINGS.green
            bounds.least[c] = min(np.quantile(own / others.min(axis=1), shorter), 1.0)
    return bounds
