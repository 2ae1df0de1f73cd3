"""Foreground fattening: next to a depth edge, pixels of the far surface get the disparity of the
near surface.

A window that lies partly on a near, textured object matches where that object matches. The gray
value of the pixel reveals the error: it is that of the far surface next to it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.context import CONTEXT_CONSTANTS, Context
from stereo_seecolor.matching.gray import Gray
from stereo_seecolor.records import Map


@dataclass(frozen=True)
class FatteningConstants:
    """Which neighbors a pixel is compared with, and what difference counts.

    reach: samples on each side that are compared: 10 pixels, beyond the influence of the census and
    of the paths across an edge. step_px: a surface whose disparity is smaller by more than this
    lies behind. same_px: neighbors within this lie on the surface.
    noise_levels: smaller differences of gray, of 255, are noise. alone_levels: difference from its
    own surface that is assumed if no neighbor lies on it.
    """

    reach: int = 2
    step_px: float = 1.5
    same_px: float = 1.0
    noise_levels: float = 2.0
    alone_levels: float = 50.0


FATTENING_CONSTANTS = FatteningConstants()
_REACH, _EVERY = FATTENING_CONSTANTS.reach, CONTEXT_CONSTANTS.every
_STEP = FATTENING_CONSTANTS.step_px
_SAME = FATTENING_CONSTANTS.same_px
_NOISE = FATTENING_CONSTANTS.noise_levels
_ALONE = FATTENING_CONSTANTS.alone_levels


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
    step, scale = np.float32(_STEP), np.float32(1 / 256)
    for y in range(best.shape[0]):
        row = min((first + y) // _EVERY, height - 1)
        for column in range(width):
            far = farthest[row, column] + step
            end = best.shape[1] if column == width - 1 else (column + 1) * _EVERY
            for x in range(column * _EVERY, end):
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
    step, same = np.float32(_STEP), np.float32(_SAME)
    behind, n_behind, own, n_own = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for j in range(max(0, row - _REACH), min(height, row + _REACH + 1)):
        for i in range(max(0, column - _REACH), min(width, column + _REACH + 1)):
            apart = disparities[j, i] - disparity
            is_behind = np.float32(1) if apart < -step else np.float32(0)
            is_own = np.float32(1) if abs(apart) <= same else np.float32(0)
            behind, n_behind = behind + is_behind * levels[j, i], n_behind + is_behind
            own, n_own = own + is_own * levels[j, i], n_own + is_own
    noise, one = np.float32(_NOISE), np.float32(1)
    to_behind = abs(level - behind / max(n_behind, one)) + noise
    to_own = (abs(level - own / n_own) if n_own > 0 else np.float32(_ALONE)) + noise
    return to_own / (to_behind + to_own)
