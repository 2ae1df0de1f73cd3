"""Removal of small patches of disparity, which are mismatches."""

import cv2
import numpy as np

from stereo_seecolor.matching.gray import LARGE_IMAGE_PX
from stereo_seecolor.records import Map

_UNKNOWN = -0x8000
PER_PX = 16
"""OpenCV's fixed-point disparities; neighbors within a pixel belong to one patch."""


def remove_speckles(disparity: Map, pixels: int) -> None:
    """Set patches of fewer than ``pixels`` of a disparity map (H, W) float32 to NaN, in
    place; connected neighbors within one pixel of disparity form a patch.
    """
    every = 2 if disparity.size > LARGE_IMAGE_PX else 1
    thin = disparity[::every, ::every]
    fixed = np.where(np.isfinite(thin), thin * np.float32(PER_PX), _UNKNOWN).astype(np.int16)
    kept = fixed.copy()
    cv2.filterSpeckles(kept, _UNKNOWN, pixels // every**2, PER_PX)
    speckle = kept != fixed
    for row in range(every):
        for column in range(every):
            part = disparity[row::every, column::every]
            part[speckle[: part.shape[0], : part.shape[1]]] = np.nan
