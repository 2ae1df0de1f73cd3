"""Prediction of whole numbers on a pixel grid, for the page: errors of left + upper - upper left,
as two planes of bytes.

Unknown pixels repeat their left neighbor, and are marked in a mask of their own. The page decodes
the numbers by sums along columns and rows (web/src/codes.ts).
"""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled

UNKNOWN = -1
"""The code of an unknown pixel."""


def predicted(codes: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(2, H, W) low and high bytes of the prediction's errors, of codes (H, W) from 0 to 65535 or
    UNKNOWN.
    """
    planes = np.empty((2, *codes.shape), np.uint8)
    _predict(codes, planes)
    return planes


@compiled
def _predict(codes, planes):  # type: ignore[no-untyped-def]
    """Fill ``planes`` with the errors modulo 2^16, small ones of either sign as small numbers."""
    height, width = codes.shape
    above = np.zeros(width, np.int32)
    for row in range(height):
        left, left_above = np.int32(0), np.int32(0)
        for column in range(width):
            code = codes[row, column]
            if code < 0:
                code = left
            error = np.int32(np.int16(code - left - above[column] + left_above))
            folded = (error << 1) ^ (error >> 31)
            planes[0, row, column], planes[1, row, column] = folded & 255, (folded >> 8) & 255
            left, left_above, above[column] = code, above[column], code
