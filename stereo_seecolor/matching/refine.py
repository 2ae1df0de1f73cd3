"""Sub-pixel disparity without pixel locking: one least-squares step of registration over a window (Lucas and Kanade 1981)."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereo_seecolor.data import Map
from stereo_seecolor.matching.images import SMOOTHING_PX, Gray

WINDOW = 7
REACH = WINDOW // 2 + 2
"""Rows beyond its own that a strip needs."""
LARGEST_STEP_PX = 1.0
MATCHING_STD_PX = 0.3
"""Standard error of what matching gives: where the images say less than that, the step shrinks towards none."""
SAMPLES = WINDOW**2 / (4 * np.pi * SMOOTHING_PX**2)
"""Independent pixels in a window: the blur before matching has correlated their noise over 4 pi sigma^2."""

_compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")


def refine_rows(left: Gray, right: Gray, disparity: Map, rows: tuple[int, int]) -> tuple[Map, Map]:
    """Disparity and its standard error, pixels, for rows[0]..rows[1]-1; NaN where disparity (H, W) is.

    The residual e = right(x - d) - left(x) and the gradient g of both images are summed over the window, means taken out
    (exposure may differ): the step is cov(g, e) / var(g), its variance that of what is left of e over n var(g). The window
    sees each neighbour at its own, smoothed disparity, so slopes do no harm.
    """
    first, end = max(0, rows[0] - REACH), min(disparity.shape[0], rows[1] + REACH)
    base = _smoothed(disparity[first:end])
    moments = np.zeros((2, *base.shape, 3), np.float32)
    _residuals(left[first:end], right[first:end], base, moments[0], moments[1])
    sums = [cv2.blur(part, (WINDOW, WINDOW), borderType=cv2.BORDER_CONSTANT) for part in moments]
    inner = slice(rows[0] - first, rows[1] - first)
    refined = np.empty((rows[1] - rows[0], base.shape[1]), np.float32)
    std = np.empty_like(refined)
    _solve(base[inner], sums[0][inner], sums[1][inner], refined, std)
    return refined, std


def _smoothed(disparity: Map) -> Map:
    """Mean over 5 x 5 of the disparities within one pixel of the centre's: steps of matching taken out, edges kept."""
    across, both = np.empty_like(disparity), np.empty_like(disparity)
    _mean_near(np.ascontiguousarray(disparity), across, 0, 1)
    _mean_near(across, both, 1, 0)
    return both


@_compiled
def _mean_near(disparity: Map, mean: Map, down: int, across: int) -> None:
    height, width = disparity.shape
    for y in range(height):
        for x in range(width):
            centre = disparity[y, x]
            total, count = np.float32(0), np.float32(0)
            for i in range(-2, 3):
                row, column = min(max(y + i * down, 0), height - 1), min(max(x + i * across, 0), width - 1)
                value = disparity[row, column]
                near = abs(value - centre) < np.float32(1)
                total += value if near else np.float32(0)
                count += np.float32(1) if near else np.float32(0)
            mean[y, x] = total / count


@_compiled
def _residuals(left: Gray, right: Gray, disparity: Map, first: NDArray[np.float32], second: NDArray[np.float32]) -> None:
    """first: 1, g, e; second: g g, g e, e e; zero where nothing is known. Gray levels of 8 bits."""
    height, width = disparity.shape
    scale = np.float32(1 / 256)
    for y in range(height):
        for x in range(1, width - 1):
            place = np.float32(x) - disparity[y, x]
            if not (place >= 1 and place < width - 3):
                continue
            i = int(place)
            t = place - np.float32(i)
            a, b = np.float32(right[y, i - 1]), np.float32(right[y, i])
            c, d = np.float32(right[y, i + 1]), np.float32(right[y, i + 2])
            # Catmull-Rom cubic through b and c
            c1, c2, c3 = (c - a) / 2, a - np.float32(2.5) * b + 2 * c - d / 2, (d - a) / 2 + np.float32(1.5) * (b - c)
            value = b + t * (c1 + t * (c2 + t * c3))
            slope = c1 + t * (2 * c2 + 3 * t * c3)
            left_slope = (np.float32(left[y, x + 1]) - np.float32(left[y, x - 1])) / 2
            g = (slope + left_slope) / 2 * scale
            e = (value - np.float32(left[y, x])) * scale
            first[y, x, 0], first[y, x, 1], first[y, x, 2] = 1, g, e
            second[y, x, 0], second[y, x, 1], second[y, x, 2] = g * g, g * e, e * e


@_compiled
def _solve(base: Map, first: NDArray[np.float32], second: NDArray[np.float32], refined: Map, std: Map) -> None:
    height, width = base.shape
    prior = np.float32(1 / MATCHING_STD_PX**2)
    for y in range(height):
        for x in range(width):
            share = first[y, x, 0]
            if not np.isfinite(base[y, x]) or share < 0.15:
                refined[y, x], std[y, x] = base[y, x], np.nan if np.isnan(base[y, x]) else LARGEST_STEP_PX
                continue
            g, e = first[y, x, 1] / share, first[y, x, 2] / share
            gg, ge, ee = second[y, x, 0] / share - g * g, second[y, x, 1] / share - g * e, second[y, x, 2] / share - e * e
            noise = max(ee - ge * ge / max(gg, np.float32(1e-6)), np.float32(1e-4))
            information = gg * share * SAMPLES / noise
            step = ge * share * SAMPLES / noise / (information + prior)
            refined[y, x] = base[y, x] + min(max(step, -LARGEST_STEP_PX), LARGEST_STEP_PX)
            std[y, x] = 1 / np.sqrt(information + prior)
