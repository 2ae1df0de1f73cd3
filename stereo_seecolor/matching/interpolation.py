"""Interpolation of unknown disparities."""

import cv2
import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Map

REACH = 0.1
"""Largest distance of an interpolated pixel from a measured pixel of its row, fraction of the
width.
"""


def fill(disparity: Map) -> Map:
    """Fill the holes of a disparity map.

    A surface that only one camera sees lies behind, so a hole gets the smaller disparity of its two
    ends in the row (Hirschmueller 2008, section 2.5), then the median of 5 x 5, which connects the
    rows. Smoothing across the hole (WLS) was worse.

    Args:
        disparity: (H, W) float32 pixels, NaN = unknown.

    Returns:
        (H, W) float32; measured pixels do not change, and pixels too far from any measured one stay
            NaN.
    """
    ends = np.empty_like(disparity)
    _ends(disparity, REACH * disparity.shape[1], ends)
    joined: Map = cv2.medianBlur(np.nan_to_num(ends), 5)
    _keep(disparity, ends, joined)
    return joined


@compiled
def _ends(disparity: Map, reach: float, ends: Map) -> None:
    """Each pixel of a hole the smaller of the row's known ends, NaN where both are too far."""
    height, width = disparity.shape
    for y in range(height):
        last = -width
        for x in range(width):
            if np.isfinite(disparity[y, x]):
                last = x
            ends[y, x] = disparity[y, last] if x - last <= reach else np.nan
        last = 2 * width
        for x in range(width - 1, -1, -1):
            if np.isfinite(disparity[y, x]):
                last = x
            if last - x <= reach and not ends[y, x] <= disparity[y, last]:
                ends[y, x] = disparity[y, last]


@compiled
def _keep(disparity: Map, ends: Map, joined: Map) -> None:
    """Put back what was measured, and NaN where nothing can be interpolated."""
    for y in range(joined.shape[0]):
        for x in range(joined.shape[1]):
            interpolated = joined[y, x] if np.isfinite(ends[y, x]) else np.float32(np.nan)
            joined[y, x] = disparity[y, x] if np.isfinite(disparity[y, x]) else interpolated
