"""Limits the colors of pixels with an interpolated range to those of measured pixels.

If an interpolated range is too large, too much backscatter is subtracted, and red, the most
attenuated channel, gets far too much gain: rims and caves in front of open water become red. Open
water has no range; its scattered light, corrected like a surface, becomes cyan, blue, violet or
pink. So at pixels with an interpolated range, no channel exceeds the greater of the other two by
more than in nearly all measured pixels, red falls below the lesser of the other two by no more than
there, and green by no more than in half of them. Small holes are not limited: their ranges lie
between measured ones, and rare colors, for example of a red sponge, stay. The strip outside the
view of the right camera is not limited either, because it cannot be matched.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Mask

RED, GREEN = 0, 1


@dataclass(frozen=True)
class BoundSettings:
    """Settings of the limits."""

    quantile: float = 0.97
    """Fraction of measured pixels within the bounds: wrong matches and the noise of far ones are a
    few percent. With 0.95, synthetic holes in photographs under water are 0.1 degrees worse; with
    0.97 open water was not red in any inspected image.
    """
    green: float = 0.5
    """Fraction of measured pixels below the least green of interpolated ones: without it, open
    water was violet.
    """
    least_light: float = 0.007
    """Least linear light of a divisor: ratios of darker pixels are noise."""
    every_px: int = 8
    """Step of rows and columns that are examined."""
    hole_px: int = 15
    """Least width of areas with limited colors, pixels: holes are narrower."""
    fewest: int = 100
    """Least measured pixels for bounds."""


SETTINGS = BoundSettings()


class Bounds(NamedTuple):
    """most (3,): largest ratio of a channel to the greater of the other two. least (3,): least
    ratio to the lesser.
    """

    most: NDArray[np.float32]
    least: NDArray[np.float32]


def within_measured(image: NDArray[Any], carried: Mask, measured: Mask) -> NDArray[Any]:
    """Limit the colors of a corrected image (H, W, 3), encoded uint8 or uint16, or
    float32 in linear light, to measured ones where the range is interpolated. carried, measured:
    (H, W) bool, True where the range is interpolated, and measured.
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


def inside_right_image(carried: Mask, outside: Mask) -> Mask:
    """The interpolated areas (H, W) without those that lie mostly outside the right image
    (``RectifiedPair.outside_right``).
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
    """Compute the bounds from the measured pixels; None if there are too few."""
    encoded = np.issubdtype(image.dtype, np.integer)
    dark = (
        encode_srgb(np.array(SETTINGS.least_light)) * np.iinfo(image.dtype).max
        if encoded
        else SETTINGS.least_light
    )
    seen = image[measured].T.astype(np.float32, order="C")
    bounds = Bounds(np.full(3, np.inf, np.float32), np.zeros(3, np.float32))
    for c in range(3):
        a, b = _others(c)
        own, *others = seen[:, np.minimum(seen[a], seen[b]) > dark][[c, a, b]]
        if own.size < SETTINGS.fewest:
            return None
        # gray is always within the bounds
        bounds.most[c] = max(np.quantile(own / np.maximum(*others), SETTINGS.quantile), 1.0)
        if c in (RED, GREEN):
            shorter = 1 - SETTINGS.quantile if c == RED else SETTINGS.green
            bounds.least[c] = min(np.quantile(own / np.minimum(*others), shorter), 1.0)
    return bounds
