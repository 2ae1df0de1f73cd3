"""Whole numbers in few bytes, for the page: the difference of each from the one before, deflated.

The page adds them up again in web/src/codes.ts.
"""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.deflate import deflated, deflated_runs


def coded(numbers: NDArray[np.integer], repeats: bool = False) -> bytes:
    """Whole numbers of any shape, row after row, whose differences are below 2^23.

    Differences of either sign are folded to 0, 1, 2, 3 ... (0, -1, 1, -2 ...). Each takes three
    bytes; the lowest bytes of all come first. repeats: as for ``deflated``.
    """
    values = np.ravel(numbers).astype(np.int32)
    differences = np.diff(values, prepend=np.int32(0))
    folded = ((differences << 1) ^ (differences >> 31)).astype("<u4")
    planes = np.ascontiguousarray(folded.view(np.uint8).reshape(-1, 4)[:, :3].T)
    return deflated(planes.data, repeats=True) if repeats else deflated_runs(planes.data)
