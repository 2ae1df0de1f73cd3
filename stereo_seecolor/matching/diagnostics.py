"""Pairs that cannot give a map, and maps that should not be trusted: what to tell the user."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.sgm.images import Census, Gray
from stereo_seecolor.records import Map

FULL_SCALE = 65280
BLACK, SATURATED = 0.02 * FULL_SCALE, 0.985 * FULL_SCALE
LEAST_TEXTURE = 0.25 * 256
"""Standard deviation of the 1/2 or 1/4 size image: a quarter of an 8-bit level, which is rounding alone."""
REPEATED_SHARE, ONE_SIDED_SHARE = 0.05, 0.01
LEAST_EXCESS_PX = 6
REPEATED_SIMILARITY = 0.85
WINDOW = (16, 64)
NO_MATTER_SHARE = 0.05
"""Rows shifted must agree better than unshifted ones by this share to count."""
LARGEST_ROW_SHIFT = 4
BAD_ROW_SHIFT_PX = 0.75


def unusable(left: Gray, right: Gray) -> str | None:
    """Why this pair, seen small, cannot be matched at all; None if it can."""
    for side, image in (("left", left), ("right", right)):
        half, most = np.percentile(image[::4, ::4], (50, 99))
        if most < BLACK:
            return f"the {side} image is black"
        if half > SATURATED:
            return f"the {side} image is saturated"
        if float(image.std()) < LEAST_TEXTURE:
            return f"the {side} image is uniform: there is nothing to match"
    if np.array_equal(left, right):
        return "left and right are the same image"
    return None


def repeated(image: Gray, search_px: int) -> NDArray[np.bool_]:
    """(H, W) True where the rows of a small image repeat themselves within the disparities searched: any of them would match.

    Told from the autocorrelation of windows of WINDOW pixels: a second peak nearly as high as the first.
    """
    height, width = image.shape
    mask = np.zeros(image.shape, np.bool_)
    rows, columns = min(WINDOW[0], height), min(WINDOW[1], width)
    tops = [*range(0, height - rows, rows), height - rows]
    lefts = [*range(0, width - columns, columns // 2), width - columns]
    windows = np.stack([[image[y : y + rows, x : x + columns] for x in lefts] for y in tops]).astype(np.float32)
    windows -= windows.mean(axis=-1, keepdims=True)
    power = (np.abs(np.fft.rfft(windows, 2 * columns)) ** 2).sum(axis=-2)
    lags = np.arange(min(search_px, columns // 2) + 1)
    similarity = np.fft.irfft(power)[..., : lags.size] * (columns / (columns - lags))
    energy = np.maximum(similarity[..., :1], rows * columns * LEAST_TEXTURE**2)
    past_first_peak = np.maximum.accumulate(similarity < 0.3 * energy, axis=-1)
    again = np.where(past_first_peak, similarity / energy, 0).max(axis=-1) > REPEATED_SIMILARITY
    for i, j in np.argwhere(again):
        mask[tops[i] : tops[i] + rows, lefts[j] : lefts[j] + columns] = True
    return mask


def repeats(repeated: NDArray[np.bool_]) -> str | None:
    """Told when a good part of the image repeats itself."""
    share = float(repeated.mean())
    if share < REPEATED_SHARE:
        return None
    return f"the texture repeats over {share:.0%} of the left image: many ranges match there, so none is given"


def one_sided(left: Gray, disparity: Map, repeated: NDArray[np.bool_], scale: int) -> str | None:
    """Told when the left image has a textured thing that the right one lacks: a fish, or a lens half covered.

    left, disparity: small, the disparity in pixels of the full size, ``scale`` times this one. A hole in a row as long as the
    disparity jumps up across it is an occlusion; what is longer has no such excuse.
    """
    lonely = np.zeros(disparity.shape, np.uint8)
    _long_holes(disparity, np.float32(scale), lonely)
    texture = cv2.blur(cv2.absdiff(left, cv2.blur(left, (5, 5))), (5, 5)) > 256
    lonely &= texture & ~repeated
    share = float(cv2.morphologyEx(cv2.medianBlur(lonely, 5), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)).mean())
    if share < ONE_SIDED_SHARE:
        return None
    why = "it moved, covers one lens, or is nearer than matching.min_range_m"
    return f"{share:.1%} of the left image finds no counterpart in the right one: {why}"


@compiled
def _long_holes(disparity: Map, scale: Any, hole: NDArray[np.uint8]) -> None:
    """1 in the holes of a row that are longer than the occlusion that the disparities at their ends make."""
    height, width = disparity.shape
    for y in range(height):
        before = width
        for x in range(width):
            if not np.isfinite(disparity[y, x]):
                continue
            if x - before > 1 and x - before - 1 - max(disparity[y, x] - disparity[y, before], 0) / scale > LEAST_EXCESS_PX:
                hole[y, before + 1 : x] = 1
            before = x


def misaligned(shift_px: float) -> str | None:
    """Told when rows do not correspond."""
    if abs(shift_px) < BAD_ROW_SHIFT_PX:
        return None
    return f"rows of left and right are {shift_px:+.1f} px apart: the calibration no longer fits, ranges are unsure"


def row_shift_px(left: Census, right: Census, origin: int, disparity: Map) -> float:
    """The shift of the right rows with which matched pixels agree best; 0 where that cannot be told."""
    cost = _row_costs(left, right, origin, disparity)
    best = int(np.argmin(cost))
    if cost[best] >= (1 - NO_MATTER_SHARE) * cost[LARGEST_ROW_SHIFT]:
        return 0.0
    if not 0 < best < cost.size - 1:
        return float(best - LARGEST_ROW_SHIFT)
    below, here, above = cost[best - 1 : best + 2]
    return float(best - LARGEST_ROW_SHIFT + 0.5 * (below - above) / max(max(below, above) - here, 1e-9))


@compiled
def _row_costs(left: Census, right: Census, origin: int, disparity: Map) -> NDArray[np.float64]:
    """Mean bits by which matched pixels differ, for each shift of rows; every 16th pixel of every 16th row."""
    height, width = left.shape
    cost = np.zeros(2 * LARGEST_ROW_SHIFT + 1, np.float64)
    for y in range(LARGEST_ROW_SHIFT, height - LARGEST_ROW_SHIFT, 16):
        for x in range(0, width, 16):
            if not np.isfinite(disparity[y, x]):
                continue
            place = origin - x + int(np.rint(disparity[y, x]))
            for i in range(cost.size):
                different = left[y, x] ^ right[y + i - LARGEST_ROW_SHIFT, place]
                different -= (different >> np.uint32(1)) & np.uint32(0x55555555)
                different = (different & np.uint32(0x33333333)) + ((different >> np.uint32(2)) & np.uint32(0x33333333))
                different = (different + (different >> np.uint32(4))) & np.uint32(0x0F0F0F0F)
                cost[i] += np.uint32(different * np.uint32(0x01010101)) >> np.uint32(24)
    return cost
