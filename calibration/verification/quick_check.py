"""A quick look at one pair, an eighth of the time of a full check: whether its rows agree, and how
far away its points are.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from calibration.geometry import Array
from calibration.rectification import Rectification
from calibration.verification.matches import QUICK, Images, Matches, find_matches
from calibration.verification.vertical_disparity import BEHIND_PX, LIMITS, MIN_MATCHES

LEAST_PIXELS = 1.6e5
"""Images smaller than that at a third of their size show too few features there."""
STRAY_PX = 1.0
"""A row that much off the median is not a match of the same point."""


@dataclass(frozen=True, eq=False)
class QuickCheck:
    """The outcome of a quick look. rows_agree: to a quarter of a pixel, and left is left; False
    also if too little matches to tell.

    matches: in the images that are matched. range_m: (n,) of the points in front of the cameras,
    along the ray; empty if too little matches to tell.
    """

    rows_agree: bool
    matches: Matches
    range_m: Array


def quick_check(rectification: Rectification, images: Images) -> QuickCheck:
    """Look at one raw pair. ``vertical_disparity`` says what is wrong where rows do not agree."""
    pair = rectification.matching_pair
    step_px = min(QUICK.step_px, math.ceil(math.sqrt(math.prod(pair.image_size) / LEAST_PIXELS)))
    found = find_matches(rectification, *images, replace(QUICK, step_px=step_px))
    if len(found.left) < MIN_MATCHES:
        return QuickCheck(False, found, np.zeros(0))
    shift_px, row_px = (found.left - found.right).T
    disparity_px = shift_px - (pair.cx_left_px - pair.cx_right_px)
    apart = np.median(disparity_px) > -BEHIND_PX  # else swapped, or one camera's image twice
    agree = np.median(np.abs(row_px)) <= LIMITS.acceptable_px and apart
    in_front = (np.abs(row_px - np.median(row_px)) < STRAY_PX) & (disparity_px > -BEHIND_PX)
    rays = (found.left[in_front] - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
    depth_m = pair.focal_px * pair.baseline_m / disparity_px[in_front]
    return QuickCheck(bool(agree), found, depth_m * np.sqrt(1 + (rays**2).sum(axis=1)))
