"""A quick look at one pair, an eighth of the time of a full check: whether its rows agree, and how far away its points are."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.keystone import find_keystone
from calibration.matches import QUICK, Images, find_matches
from calibration.rectification import Rectification
from calibration.row_check import LIMITS

Array = NDArray[np.float64]
MIN_MATCHES = 50  # fewer do not reach the corners of the image, where roll and scale show
BEHIND_PX = -0.5  # disparity of a point behind infinity: beyond the noise of matches, about 0.1 px
LEAST_PIXELS = 1.6e5  # images smaller than that at a third of their size show too few features there
STRAY_PX = 1.0  # a row that much off the median is no match of the same point


@dataclass(frozen=True, eq=False)
class QuickLook:
    """The outcome of a quick look. rows_agree: to a quarter of a pixel, and left is left; False also if too little matches to tell.

    keystone: True if there may be one that stands for wrong ranges, which more pairs must tell.
    range_m: (n,) of the points in front of the cameras, along the ray; empty if too little matches to tell.
    """

    rows_agree: bool
    keystone: bool
    range_m: Array


def quick_look(rectification: Rectification, images: Images) -> QuickLook:
    """Look at one raw pair. ``vertical_disparity`` says what is wrong where rows do not agree."""
    pair = rectification.matching_pair
    step_px = min(QUICK.step_px, math.ceil(math.sqrt(math.prod(pair.image_size) / LEAST_PIXELS)))
    found = find_matches(rectification, *images, replace(QUICK, step_px=step_px))
    if len(found.left) < MIN_MATCHES:
        return QuickLook(False, False, np.zeros(0))
    shift_px, row_px = (found.left - found.right).T
    disparity_px = shift_px - (pair.cx_left_px - pair.cx_right_px)
    apart = np.median(disparity_px) > -BEHIND_PX  # else swapped, or one camera's picture twice
    agree = np.median(np.abs(row_px)) <= LIMITS.acceptable_px and apart
    centered = (found.left - [pair.cx_left_px, pair.cy_px], found.right - [pair.cx_right_px, pair.cy_px])
    keystone = find_keystone(*centered, np.zeros(len(row_px), np.int64), pair.focal_px)
    in_front = (np.abs(row_px - np.median(row_px)) < STRAY_PX) & (disparity_px > -BEHIND_PX)
    return QuickLook(bool(agree), keystone.is_possible, _range_m(pair, found.left[in_front], disparity_px[in_front]))


def _range_m(pair: RectifiedPair, left: Array, disparity_px: Array) -> Array:
    slopes = (left - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
    return np.asarray(pair.focal_px * pair.baseline_m / disparity_px * np.sqrt(1 + (slopes**2).sum(axis=1)))
