"""Removal of small patches of disparity, which are mismatches."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Map

LARGE_IMAGE_PX = 600_000
"""Beyond this size every second pixel decides: the filter is not compiled for cores, and patches
are larger, too.
"""
_UNKNOWN = -0x8000
PER_PX = 16
"""OpenCV's fixed-point disparities; neighbors that differ by a pixel or less belong to one
patch.
"""


def remove_speckles(disparity: Map, pixels: int) -> None:
    """Set disparities to NaN, in place, where fewer than ``pixels`` connected pixels share a
    disparity to within one pixel.
    """
    every = 2 if disparity.size > LARGE_IMAGE_PX else 1
    fixed = np.empty((-(-disparity.shape[0] // every), -(-disparity.shape[1] // every)), np.int16)
    _thin(disparity, every, fixed)
    kept = fixed.copy()
    cv2.filterSpeckles(kept, _UNKNOWN, pixels // every**2, PER_PX)
    _remove(disparity, every, cv2.compare(kept, fixed, cv2.CMP_NE))


@compiled
def _thin(disparity: Map, every: int, fixed: NDArray[np.int16]) -> None:
    for y in range(fixed.shape[0]):
        for x in range(fixed.shape[1]):
            d = disparity[y * every, x * every]
            fixed[y, x] = np.int16(d * np.float32(PER_PX)) if np.isfinite(d) else np.int16(_UNKNOWN)


@compiled
def _remove(disparity: Map, every: int, speckle: NDArray[np.uint8]) -> None:
    for y in range(speckle.shape[0]):
        for x in range(speckle.shape[1]):
            if speckle[y, x]:
                disparity[y * every : (y + 1) * every, x * every : (x + 1) * every] = np.nan
