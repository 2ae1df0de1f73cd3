"""Sub-pixel refinement by one least-squares step of registration (Lucas and Kanade 1981)."""

from typing import Any

import cv2
import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.gray import SMOOTHING_PX, Gray, GrayPair
from stereo_seecolor.records import Map

WINDOW, SMOOTHED = 7, 5
"""Sides of the windows of the registration and of the smoothing before it, pixels; sums below are
written out for them.
"""
PIXELS = WINDOW**2
MOMENTS = 7

LARGEST_STEP_PX = 1.0
"""Of the refinement: a correct match is right to a pixel."""
MATCHING_STD_PX = 0.3
"""Standard error of the integer disparity; if the images contain less information than this, the
step shrinks to zero.
"""
SAMPLES = PIXELS / (4 * np.pi * SMOOTHING_PX**2)
"""Independent pixels in a window: the blur before matching has correlated their noise over 4 pi
sigma^2.
"""
REPEATED_STRIPS, REPEATED_ROWS = 4, 24
"""The refinement is repeated on so many strips of so many rows."""
REPEATED_STDS = 0.55
"""How far it moves disparities, in standard errors, where these are right."""
_PRIOR = 1 / MATCHING_STD_PX**2
_LEAST = np.float32(1e-3)


def contrast_gain(left: Gray, right: Gray) -> float:
    """The standard deviation of the left image's gray levels over that of the right one's."""
    of_left, of_right = (
        float(cv2.meanStdDev(image[::4, ::4].copy())[1][0, 0]) for image in (left, right)
    )
    return of_left / max(of_right, 1e-6)


def refine_rows(
    pair: GrayPair, gain: float, matched: MatchedDisparity, first: int, refined: Map, std: Map
) -> tuple[Map, Map]:
    """Refine disparities: fill ``refined`` and ``std`` (pixels), starting at row ``first`` of
    matched.best; return support and relief.

    gain: contrast of left over right. The residual e = gain right(x - d) - left(x) and the gradient
    g of both images are summed over the window, means taken out: the step is cov(g, e) / var(g),
    its variance that of the remaining e over n var(g). Each neighbor in the window is compared at
    its own, smoothed disparity, so slopes cause no error; neighbors that failed a check are left
    out.
    support: fraction of the window that passed the checks.
    relief: |disparity - its mean over those|, pixels: large beside an edge. All are (rows, W), NaN
    where matched.best is.
    """
    support, relief = np.empty_like(refined), np.empty_like(refined)
    images, rows = (pair.left, pair.right), (first, first + refined.shape[0])
    _refine(
        images,
        np.float32(gain),
        (matched.disparity, matched.best),
        rows,
        (refined, std, support, relief),
    )
    return support, relief


def error_factor(left: Gray, right: Gray, disparity: Map) -> float:
    """Compute by how much the standard errors of a pair's refined disparities are too small.

    They take the noise of pixels as independent, but for the blur before matching. Where a filter,
    a compression or an interpolation has correlated it, or removed texture with it, refining the
    refined disparities moves them by more of a standard error. This is measured on some rows, in
    standard errors of the step by the noise of the images, which the prior shrinks with the step.

    disparity: (H, W) pixels, refined; NaN where unknown.

    Returns:
        1 or more; 1 where hardly any disparities are known.
    """
    gain, rows = np.float32(contrast_gain(left, right)), REPEATED_ROWS
    firsts = np.linspace(0, max(len(disparity) - rows, 0), REPEATED_STRIPS + 2)[1:-1]
    moved = []
    for first in firsts.astype(int):
        strip = slice(first, first + rows)
        here = disparity[strip]
        again, std, support, relief = np.empty((4, *here.shape), np.float32)
        images, all_rows = (left[strip], right[strip]), (0, len(here))
        _refine(images, gain, (here, here), all_rows, (again, std, support, relief))
        information = np.maximum(1 / std**2 - _PRIOR, _LEAST)
        stds = np.abs(again - here) / (std**2 * np.sqrt(information))
        moved.append(stds[np.isfinite(stds)][::4])
    every = np.concatenate(moved)
    if every.size < PIXELS:
        return 1.0
    return max(1.0, 1.4826 * float(np.median(every)) / REPEATED_STDS)


@compiled
def _refine(
    images: tuple[Gray, Gray],
    gain: Any,
    matched: tuple[Map, Map],
    rows: tuple[int, int],
    found: tuple[Map, Map, Map, Map],
) -> None:
    """Fill the four maps of ``refine_rows`` in one pass over the rows rows[0] to rows[1] - 1.

    found: refined, std, support, relief. Intermediate values are kept in rings of as many rows as a
    window has, which fit the processor's cache.
    """
    left, right = images
    disparity, best = matched
    refined, std, support, relief = found
    height, width = disparity.shape
    half, near = WINDOW // 2, SMOOTHED // 2
    across = np.empty((SMOOTHED, width), np.float32)
    base = np.empty((WINDOW, width), np.float32)
    samples = np.zeros((MOMENTS + 1, width + 2 * half), np.float32)
    places, fetched = np.empty(width, np.int32), np.empty(width, np.uint64)
    ring = np.zeros((WINDOW, MOMENTS, width), np.float32)
    moments = np.empty((MOMENTS, width), np.float32)
    first = max(0, rows[0] - half)
    for y in range(max(0, first - near), min(height, first + near)):
        _smooth_across(disparity[y], across[y % SMOOTHED])
    for y in range(first, rows[1] + half):
        sums = ring[y % WINDOW]
        if y < height:
            if y + near < height:
                _smooth_across(disparity[y + near], across[(y + near) % SMOOTHED])
            here = base[y % WINDOW]
            above, above2 = across[max(y - 1, 0) % SMOOTHED], across[max(y - 2, 0) % SMOOTHED]
            below = across[min(y + 1, height - 1) % SMOOTHED]
            below2 = across[min(y + 2, height - 1) % SMOOTHED]
            _mean_near(across[y % SMOOTHED], above2, above, below, below2, here)
            _residuals(left[y], right[y], here, gain, samples, half, places, fetched)
            for moment in range(MOMENTS):
                _sum_across(samples[moment], sums[moment])
        else:
            sums[:] = 0
        row = y - half
        if row >= rows[0]:
            for moment in range(MOMENTS):
                _sum_down(ring, moment, moments[moment])
            i = row - rows[0]
            for x in range(moments.shape[1]):
                support[i, x] = moments[0, x]
            _solve(base[row % WINDOW], best[row], moments, refined[i], std[i], relief[i])


@compiled
def _smooth_across(disparity: Any, mean: Any) -> None:
    # one by one: for whole slices numba would compile a message about shapes, for two seconds
    for x in (0, 1, -2, -1):
        mean[x] = disparity[x]
    _mean_near(
        disparity[2:-2], disparity[:-4], disparity[1:-3], disparity[3:-1], disparity[4:], mean[2:-2]
    )


@compiled
def _mean_near(center: Any, n0: Any, n1: Any, n2: Any, n3: Any, mean: Any) -> None:
    """Mean with neighbors within one pixel: no steps of matching, and edges kept."""
    one, none = np.float32(1), np.float32(0)
    for x in range(center.size):
        here = center[x]
        near0 = abs(n0[x] - here) < one
        near1 = abs(n1[x] - here) < one
        near2 = abs(n2[x] - here) < one
        near3 = abs(n3[x] - here) < one
        total = (
            here
            + (n0[x] if near0 else none)
            + (n1[x] if near1 else none)
            + (n2[x] if near2 else none)
            + (n3[x] if near3 else none)
        )
        count = (
            one
            + (one if near0 else none)
            + (one if near1 else none)
            + (one if near2 else none)
            + (one if near3 else none)
        )
        mean[x] = total / count


@compiled
def _residuals(
    left: Any,
    right: Any,
    disparity: Any,
    gain: Any,
    samples: Any,
    margin: int,
    first: Any,
    fetched: Any,
) -> None:
    """Write one row's samples: 1, g, e, g g, g e, e e, d, in gray levels of 8 bits, zero where
    nothing is known; then scratch.

    Pixels of the right image, whose places follow the disparity, are gathered first; the arithmetic
    then runs as vector code.
    """
    width = disparity.size
    scale, half = np.float32(1 / 256), np.float32(0.5)
    one = samples[0, margin : margin + width]
    g = samples[1, margin : margin + width]
    e = samples[2, margin : margin + width]
    gg = samples[3, margin : margin + width]
    ge = samples[4, margin : margin + width]
    ee = samples[5, margin : margin + width]
    d = samples[6, margin : margin + width]
    fraction = samples[7, margin : margin + width]
    nearest = np.float32(1)
    none = np.float32(0)
    last = np.float32(width - 3)
    low = np.uint64(0xFFFF)
    for x in range(width):
        place = np.float32(x) - disparity[x]
        inside = (place >= nearest) & (place < last) & (x > 0) & (x < width - 1)
        i = np.int32(place if inside else nearest)
        first[x] = i - 1
        one[x] = nearest if inside else none
        fraction[x] = place - np.float32(i) if inside else none
    for x in range(width):
        at = first[x]
        near = np.uint64(right[at]) | np.uint64(right[at + 1]) << np.uint64(16)
        fetched[x] = (
            near
            | np.uint64(right[at + 2]) << np.uint64(32)
            | np.uint64(right[at + 3]) << np.uint64(48)
        )
    before, here, after = left[: width - 2], left[1 : width - 1], left[2:]
    for x in range(1, width - 1):
        t, met = fraction[x], fetched[x]
        a, b = np.float32(np.int32(met & low)), np.float32(np.int32((met >> np.uint64(16)) & low))
        c = np.float32(np.int32((met >> np.uint64(32)) & low))
        f = np.float32(np.int32(met >> np.uint64(48)))
        # Catmull-Rom cubic through b and c
        c1 = half * (c - a)
        c2 = a - np.float32(2.5) * b + np.float32(2) * c - half * f
        c3 = half * (f - a) + np.float32(1.5) * (b - c)
        value = b + t * (c1 + t * (c2 + t * c3))
        slope = c1 + t * (np.float32(2) * c2 + np.float32(3) * t * c3)
        left_slope = half * (np.float32(after[x - 1]) - np.float32(before[x - 1]))
        gradient = one[x] * (half * scale * (gain * slope + left_slope))
        residual = one[x] * (scale * (gain * value - np.float32(here[x - 1])))
        g[x], e[x], d[x] = gradient, residual, disparity[x] if one[x] > 0 else np.float32(0)
        gg[x], ge[x], ee[x] = gradient * gradient, gradient * residual, residual * residual


@compiled
def _sum_across(values: Any, total: Any) -> None:
    width = total.size
    a, b, c = values[0 : 0 + width], values[1 : 1 + width], values[2 : 2 + width]
    d, e, f = values[3 : 3 + width], values[4 : 4 + width], values[5 : 5 + width]
    g = values[6 : 6 + width]
    for x in range(width):
        total[x] = a[x] + b[x] + c[x] + d[x] + e[x] + f[x] + g[x]


@compiled
def _sum_down(ring: Any, moment: int, mean: Any) -> None:
    a, b, c = ring[0, moment], ring[1, moment], ring[2, moment]
    d, e, f = ring[3, moment], ring[4, moment], ring[5, moment]
    g = ring[6, moment]
    scale = np.float32(1 / PIXELS)
    for x in range(mean.size):
        mean[x] = (a[x] + b[x] + c[x] + d[x] + e[x] + f[x] + g[x]) * scale


@compiled
def _solve(base: Any, best: Any, moments: Any, refined: Any, std: Any, relief: Any) -> None:
    """Solve one row: refined disparity, its standard error, and relief.

    base: disparities that passed the checks, smoothed; elsewhere ``best`` takes its place.
    """
    one, largest = np.float32(1), np.float32(LARGEST_STEP_PX)
    prior, samples = np.float32(_PRIOR), np.float32(SAMPLES)
    least, dark, still = np.float32(0.02), np.float32(1e-6), np.float32(1e-4)
    known_row, g_row, e_row = moments[0], moments[1], moments[2]
    gg_row, ge_row, ee_row = moments[3], moments[4], moments[5]
    d_row = moments[6]
    for x in range(base.size):
        fraction = known_row[x]
        known = one / (fraction if fraction > least else least)
        g, e = g_row[x] * known, e_row[x] * known
        gg = gg_row[x] * known - g * g
        gg = gg if gg > dark else dark
        ge = ge_row[x] * known - g * e
        noise = ee_row[x] * known - e * e - ge * ge / gg
        noise = noise if noise > still else still
        weight = fraction * samples / noise
        information = gg * weight + prior
        step = ge * weight / information
        step = step if step < largest else largest
        here = base[x] if base[x] == base[x] else best[x]
        refined[x] = here + (step if step > -largest else -largest)
        std[x] = one / np.sqrt(information)
        relief[x] = abs(here - d_row[x] * known)
