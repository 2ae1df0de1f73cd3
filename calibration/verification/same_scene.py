"""Whether two images show the same scene: features that agree with the rectification."""

import numpy as np

from calibration.rectification import Image, Rectification
from calibration.verification.matches import (
    MATCH_LIMITS,
    QUICK,
    Described,
    MatchLimits,
    describe_left,
    describe_right,
    find_matches,
    match_described,
    similar_points,
)
from calibration.verification.vertical_disparity import LIMITS as ROW_LIMITS

ROW_PX = 3.0
"""Rows of matched features differ by no more: a rig that has drifted is off by a pixel or two (0.6
px on a real dive).
"""
ENOUGH_POINTS = 40
"""False pairs of the sample dive and of a real reef have 4 at most, true ones 1,200 and more."""


def agreeing_points(
    rectification: Rectification,
    left: Described,
    right: Described,
    limits: MatchLimits = MATCH_LIMITS,
) -> int:
    """Count the features of the rectified left image that are found in the right one on the same
    row, in front of the cameras.
    """
    found = match_described(left, right, limits)
    disparity_px, row_px = (found.left - found.right).T if len(found.left) else np.zeros((2, 0))
    infinity_px = rectification.matching_pair.cx_left_px - rectification.matching_pair.cx_right_px
    return int(np.count_nonzero((np.abs(row_px) < ROW_PX) & (disparity_px > infinity_px - 1)))


def images_overlap(rectification: Rectification, left: Image, right: Image) -> bool:
    """Tell whether enough points of the raw left image are found in the raw right one: a few
    coarse features do, where there are enough; else points whose rows agree among themselves,
    which those of a wide rig that has moved do.
    """
    found = any(
        agreeing_points(
            rectification,
            describe_left(rectification, left, limits),
            describe_right(rectification, right, limits),
            limits,
        )
        >= ENOUGH_POINTS
        for limits in (QUICK, MATCH_LIMITS)
    )
    return found or len(find_matches(rectification, left, right).left) >= ENOUGH_POINTS


def is_same_picture(left: Image, right: Image) -> bool:
    """Tell whether nearly all that looks alike in two images lies at the same places of both."""
    found = similar_points(left, right)
    return (
        len(found.left) > 0
        and float(np.median(np.hypot(*(found.left - found.right).T))) < ROW_LIMITS.apart_px
    )
