"""How likely it is that a disparity is right to within one pixel, and the maps that follow from it."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from stereo_seecolor.data import Map

STD_WEIGHT, RIVAL_WEIGHT, SUPPORT_WEIGHT, RELIEF_WEIGHT, OFFSET = -3.84, 1.63, 3.50, -0.83, -8.68
"""Logistic regression on synthetic scenes in clear to turbid water (docs/matching.md has its reliability on others)."""

_compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def confidence(std: Map, rival: Map, support: Map, relief: Map) -> Map:
    """P(|disparity error| <= 1 px) from its standard error, lead over its rival, known neighbours and relief around it."""
    height, width = std.shape
    sure = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            lead = np.sqrt(min(rival[y, x], np.float32(1)))
            logit = STD_WEIGHT * np.log(std[y, x]) + RIVAL_WEIGHT * lead + SUPPORT_WEIGHT * support[y, x]
            logit += RELIEF_WEIGHT * np.log(relief[y, x] + np.float32(0.05)) + OFFSET
            sure[y, x] = 1 / (1 + np.exp(-logit))
    return sure
