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


def refine_rows(left: Gray, right: Gray, gain: float, disparity: Map, rows: tuple[int, int]) -> tuple[Map, Map, Map, Map]:
    """Disparity and its standard error, pixels, support and relief, for rows[0]..rows[1]-1; NaN where disparity (H, W) is.

    gain: contrast of left over right. The residual e = gain right(x - d) - left(x) and the gradient g of both images are
    summed over the window, means taken out: the step is cov(g, e) / var(g), its variance that of what is left of e over
    n var(g). The window sees each neighbour at its own, smoothed disparity, so slopes do no harm.
    support: share of the window that is known.
    relief: |disparity - its mean over the window|, pixels: large beside an edge.
    """
    first, end = max(0, rows[0] - REACH), min(disparity.shape[0], rows[1] + REACH)
    base = _smoothed(disparity[first:end])
    moments = np.zeros((7, *base.shape), np.float32)
    _residuals(left[first:end], right[first:end], base, np.float32(gain), moments)
    for moment in moments:
        cv2.blur(moment, (WINDOW, WINDOW), moment, borderType=cv2.BORDER_CONSTANT)
    inner = slice(rows[0] - first, rows[1] - first)
    refined, std, relief = (np.empty((rows[1] - rows[0], base.shape[1]), np.float32) for _ in range(3))
    _solve(base[inner], moments[:, inner], refined, std, relief)
    return refined, std, moments[0, inner], relief


def _smoothed(disparity: Map) -> Map:
    """Mean over 5 x 5 of the disparities within one pixel of the centre's: steps of matching taken out, edges kept."""
    across, both = disparity.copy(), np.empty_like(disparity)
    _mean_near(disparity[:, 2:-2], (disparity[:, :-4], disparity[:, 1:-3], disparity[:, 3:-1], disparity[:, 4:]), across[:, 2:-2])
    padded = np.concatenate([across[:1], across[:1], across, across[-1:], across[-1:]])
    _mean_near(across, (padded[:-4], padded[1:-3], padded[3:-1], padded[4:]), both)
    return both


@_compiled
def _mean_near(centre: Map, neighbors: tuple[Map, Map, Map, Map], mean: Map) -> None:
    one, none = np.float32(1), np.float32(0)
    for y in range(centre.shape[0]):
        c, n0, n1, n2, n3 = centre[y], neighbors[0][y], neighbors[1][y], neighbors[2][y], neighbors[3][y]
        for x in range(c.size):
            here = c[x]
            near0, near1, near2, near3 = (
                abs(n0[x] - here) < one,
                abs(n1[x] - here) < one,
                abs(n2[x] - here) < one,
                abs(n3[x] - here) < one,
            )
            total = (
                here
                + (n0[x] if near0 else none)
                + (n1[x] if near1 else none)
                + (n2[x] if near2 else none)
                + (n3[x] if near3 else none)
            )
            count = one + (one if near0 else none) + (one if near1 else none) + (one if near2 else none) + (one if near3 else none)
            mean[y, x] = total / count


@_compiled
def _residuals(left: Gray, right: Gray, disparity: Map, gain: Any, moments: NDArray[np.float32]) -> None:
    """moments: planes of 1, g, e, g g, g e, e e, d; zero where nothing is known. In gray levels of 8 bits."""
    height, width = disparity.shape
    scale, half = np.float32(1 / 256), np.float32(0.5)
    one, g, e, gg, ge, ee = moments[0], moments[1], moments[2], moments[3], moments[4], moments[5]
    for y in range(height):
        for x in range(1, width - 1):
            place = np.float32(x) - disparity[y, x]
            if not (place >= 1 and place < width - 3):
                continue
            i = np.int32(place)
            t = place - np.float32(i)
            a, b = np.float32(right[y, i - 1]), np.float32(right[y, i])
            c, d = np.float32(right[y, i + 1]), np.float32(right[y, i + 2])
            # Catmull-Rom cubic through b and c
            c1 = half * (c - a)
            c2 = a - np.float32(2.5) * b + np.float32(2) * c - half * d
            c3 = half * (d - a) + np.float32(1.5) * (b - c)
            value = b + t * (c1 + t * (c2 + t * c3))
            slope = c1 + t * (np.float32(2) * c2 + np.float32(3) * t * c3)
            left_slope = half * (np.float32(left[y, x + 1]) - np.float32(left[y, x - 1]))
            gradient = half * scale * (gain * slope + left_slope)
            residual = scale * (gain * value - np.float32(left[y, x]))
            one[y, x], g[y, x], e[y, x] = np.float32(1), gradient, residual
            moments[6, y, x] = disparity[y, x]
            gg[y, x], ge[y, x], ee[y, x] = gradient * gradient, gradient * residual, residual * residual


@_compiled
def _solve(base: Map, moments: NDArray[np.float32], refined: Map, std: Map, relief: Map) -> None:
    height, width = base.shape
    one, largest = np.float32(1), np.float32(LARGEST_STEP_PX)
    prior, samples = np.float32(1 / MATCHING_STD_PX**2), np.float32(SAMPLES)
    for y in range(height):
        share_row, g_row, e_row = moments[0, y], moments[1, y], moments[2, y]
        gg_row, ge_row, ee_row = moments[3, y], moments[4, y], moments[5, y]
        for x in range(width):
            share = share_row[x]
            known = one / max(share, np.float32(0.02))
            g, e = g_row[x] * known, e_row[x] * known
            gg = max(gg_row[x] * known - g * g, np.float32(1e-6))
            ge = ge_row[x] * known - g * e
            noise = max(ee_row[x] * known - e * e - ge * ge / gg, np.float32(1e-4))
            weight = share * samples / noise
            information = gg * weight + prior
            step = ge * weight / information
            refined[y, x] = base[y, x] + min(max(step, -largest), largest)
            std[y, x] = one / np.sqrt(information)
            relief[y, x] = abs(base[y, x] - moments[6, y, x] * known)
