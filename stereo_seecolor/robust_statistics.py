"""Statistics that outliers do not move: standard deviations by medians, and weights of residuals."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROBUST_DEVIATION = 1.4826
"""Standard deviation over median absolute deviation of a Gaussian."""
TUKEY = 4.685
"""Standard deviations beyond which a residual weighs nothing: 95 % efficient for Gaussian residuals (Beaton and Tukey 1974)."""


def deviation(values: Array) -> float:
    """Standard deviation of numbers about their median."""
    return ROBUST_DEVIATION * float(np.median(np.abs(values - np.median(values))))


def deviation_about_zero(values: Array) -> float:
    """Standard deviation of numbers about zero."""
    return ROBUST_DEVIATION * float(np.median(np.abs(values)))


def biweight(residuals: Array) -> Array:
    """Tukey's weights: 1 where a residual is 0, 0 from -1 and 1 on."""
    return np.where(np.abs(residuals) < 1, (1 - residuals**2) ** 2, 0)
