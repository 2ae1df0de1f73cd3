"""Foreground fattening: next to a depth edge, pixels of the far surface get the disparity of the
near surface.

A window that lies partly on a near, textured object matches where that object matches. The gray
value of the pixel reveals the error: it is that of the far surface next to it.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.context import EVERY, Context
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.records import Map

REACH = 2
"""Samples on each side that are compared: 10 pixels, beyond the influence of the census and of the
paths across an edge.
"""
STEP_PX, SAME_PX = 1.5, 1.0
"""A surface whose disparity is smaller by more than the first lies behind; neighbors within the
second lie on the surface.
"""
NOISE_LEVELS = 2.0
"""Smaller differences of gray, of 255, are noise."""
ALONE_LEVELS = 50.0
"""Difference from its own surface that is assumed if no neighbor lies on it."""


def fattening(
    images: tuple[Map, Gray], context: Context, rows: slice, odds: Map, least: float
) -> Map:
    """Compute how much more the gray value of a pixel resembles the surface behind it than its own
    surface: (rows, W), 0..1; 0 if no surface lies behind.

    images: disparity (MatchedDisparity.best) and left image, (H, W). odds: (rows, W); pixels below
    ``least`` are left at 0.
    """
    best, left = images
    found = np.zeros(odds.shape, np.float32)
    samples = context.disparity, context.farthest, context.levels
    _fattening((best[rows], left[rows]), rows.start, samples, odds, np.float32(least), found)
    return found


@compiled
def _fattening(
    images: Any, first: int, samples: tuple[Map, Map, Map], odds: Any, least: Any, found: Any
) -> None:
    best, left = images
    farthest = samples[1]
    height, width = farthest.shape
    step, scale = np.float32(STEP_PX), np.float32(1 / 256)
    for y in range(best.shape[0]):
        row = min((first + y) // EVERY, height - 1)
        for column in range(width):
            far = farthest[row, column] + step
            end = best.shape[1] if column == width - 1 else (column + 1) * EVERY
            for x in range(column * EVERY, end):
                if odds[y, x] >= least and best[y, x] > far:
                    found[y, x] = _likeness(
                        best[y, x], np.float32(left[y, x]) * scale, row, column, samples
                    )


@compiled(inline=True)
def _likeness(
    disparity: Any, level: Any, row: int, column: int, samples: tuple[Map, Map, Map]
) -> Any:
    """How much nearer the gray is to the mean of the samples behind than to that of those on the
    same surface.
    """
    disparities, _, levels = samples
    height, width = disparities.shape
    step, same = np.float32(STEP_PX), np.float32(SAME_PX)
    behind, n_behind, own, n_own = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for j in range(max(0, row - REACH), min(height, row + REACH + 1)):
        for i in range(max(0, column - REACH), min(width, column + REACH + 1)):
            apart = disparities[j, i] - disparity
            is_behind = np.float32(1) if apart < -step else np.float32(0)
            is_own = np.float32(1) if abs(apart) <= same else np.float32(0)
            behind, n_behind = behind + is_behind * levels[j, i], n_behind + is_behind
            own, n_own = own + is_own * levels[j, i], n_own + is_own
    noise, one = np.float32(NOISE_LEVELS), np.float32(1)
    to_behind = abs(level - behind / max(n_behind, one)) + noise
    to_own = (abs(level - own / n_own) if n_own > 0 else np.float32(ALONE_LEVELS)) + noise
    return to_own / (to_behind + to_own)
