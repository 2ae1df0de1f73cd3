"""Pairs that cannot give a map, and maps that should not be trusted: what to tell the user."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereo_seecolor.data import Map
from stereo_seecolor.matching.images import Census, Gray

FULL_SCALE = 65280
BLACK, SATURATED = 0.02 * FULL_SCALE, 0.985 * FULL_SCALE
LEAST_TEXTURE = 0.25 * 256
"""Standard deviation of the 1/2 or 1/4 size image: a quarter of an 8-bit level, which is rounding alone."""
REPEATED_SHARE, ONE_SIDED_SHARE = 0.3, 0.005
LARGEST_ROW_SHIFT = 4
BAD_ROW_SHIFT_PX = 0.75

_compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True, nogil=True)


def unusable(left: Gray, right: Gray) -> str | None:
    """Why this pair, seen small, cannot be matched at all; None if it can."""
    for side, image in (("left", left), ("right", right)):
        if np.percentile(image, 99) < BLACK:
            return f"the {side} image is black"
        if np.percentile(image, 50) > SATURATED:
            return f"the {side} image is saturated"
        if float(image.std()) < LEAST_TEXTURE:
            return f"the {side} image is uniform: there is nothing to match"
    if np.array_equal(left, right):
        return "left and right are the same image"
    return None


def repeats(rival: Map, least: float) -> str | None:
    """Told when many pixels match several disparities equally well: their lead over the next best is under ``least``."""
    share = float((rival < least).mean())
    if share < REPEATED_SHARE:
        return None
    return f"the texture repeats or is too weak: {share:.0%} of the pixels match several ranges equally well and are left unknown"


def one_sided(left: Gray, disparity: Map) -> str | None:
    """Told when the left image has a textured thing that the right one lacks: a fish, or a lens half covered.

    Occlusions beside edges are thin and go with the opening; the left strip that the right camera cannot see is left out.
    """
    known = np.isfinite(disparity)
    if not known.any():
        return None
    strip = int(np.ceil(np.nanmax(disparity)))
    texture = cv2.blur(cv2.absdiff(left, cv2.blur(left, (5, 5))), (5, 5)) > 256
    lonely = (~known & texture).astype(np.uint8)
    lonely[:, :strip] = 0
    share = float(cv2.morphologyEx(lonely, cv2.MORPH_OPEN, np.ones((7, 7), np.uint8)).mean())
    if share < ONE_SIDED_SHARE:
        return None
    return f"{share:.1%} of the left image has no counterpart in the right one (a fish, or something over one lens)"


def misaligned(shift_px: float) -> str | None:
    """Told when rows do not correspond."""
    if abs(shift_px) < BAD_ROW_SHIFT_PX:
        return None
    return f"rows of left and right are {shift_px:+.1f} px apart: the calibration no longer fits, ranges are unsure"


def row_shift_px(left: Census, right: Census, origin: int, disparity: Map) -> float:
    """The shift of the right rows with which matched pixels agree best; 0 where that cannot be told."""
    cost = _row_costs(left, right, origin, disparity)
    best = int(np.argmin(cost))
    if cost[best] == 0:
        return 0.0
    if not 0 < best < cost.size - 1:
        return float(best - LARGEST_ROW_SHIFT)
    below, here, above = cost[best - 1 : best + 2]
    return float(best - LARGEST_ROW_SHIFT + 0.5 * (below - above) / max(max(below, above) - here, 1e-9))


@_compiled
def _row_costs(left: Census, right: Census, origin: int, disparity: Map) -> NDArray[np.float64]:
    """Mean bits by which matched pixels differ, for each shift of rows; every fourth pixel of every fourth row."""
    height, width = left.shape
    cost = np.zeros(2 * LARGEST_ROW_SHIFT + 1, np.float64)
    for y in range(LARGEST_ROW_SHIFT, height - LARGEST_ROW_SHIFT, 4):
        for x in range(0, width, 4):
            if not np.isfinite(disparity[y, x]):
                continue
            place = origin - x + int(np.rint(disparity[y, x]))
            for i in range(cost.size):
                different = left[y, x] ^ right[y + i - LARGEST_ROW_SHIFT, place]
                while different:
                    different &= different - np.uint32(1)
                    cost[i] += 1
    return cost
