"""Symmetric banded systems of equations, in which each frame is coupled only to a few frames before
it.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DENSE = 400
"""Up to so many unknowns a dense solver is used (a few ms): loading scipy's solver for banded
systems takes a fifth of a second.
"""


def solve_banded(band: Array, slope: Array) -> Array:
    """(N,) solution of a positive definite system. band: (reach + 1, N) diagonal and those below.
    Both arrays are overwritten.
    """
    size = len(slope)
    if size > DENSE:
        from scipy.linalg import solveh_banded

        return np.asarray(
            solveh_banded(band, slope, overwrite_ab=True, overwrite_b=True, lower=True)
        )
    lower = np.zeros((size, size))
    for back, diagonal in enumerate(band[:size]):
        lower[np.arange(back, size), np.arange(size - back)] = diagonal[: size - back]
    return np.asarray(np.linalg.solve(lower + np.tril(lower, -1).T, slope), np.float64)
