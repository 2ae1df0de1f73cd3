"""Points that fill a cube evenly, for ensembles that are the same in every run."""

import numpy as np
from numpy.typing import NDArray


def low_discrepancy(number: int, dimensions: int) -> NDArray[np.float64]:
    """(number, dimensions) points that fill the unit cube evenly: Kronecker's sequence on roots of
    the generalized golden ratio.
    """
    ratio = 1.5
    for _ in range(40):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, number + 1)[:, None] * steps) % 1.0)
