"""Robust statistics: standard deviations by medians, and weights of residuals."""

import numpy as np

from calibration.geometry import Array

ROBUST_DEVIATION = 1.4826
"""Standard deviation over median absolute deviation of a Gaussian."""
MEDIAN_ERROR = 1.2533
"""Standard error of the median over that of the mean, of a Gaussian: the root of pi / 2."""
TUKEY = 4.685
"""Standard deviations beyond which a residual has weight 0: 95 % efficient for Gaussian residuals
(Beaton and Tukey 1974).
"""


def deviation(values: Array) -> float:
    """Robust standard deviation of values about their median."""
    return ROBUST_DEVIATION * float(np.median(np.abs(values - np.median(values))))


def deviation_about_zero(values: Array) -> float:
    """Robust standard deviation of values about zero."""
    return ROBUST_DEVIATION * float(np.median(np.abs(values)))


def biweight(residuals: Array) -> Array:
    """Tukey's weights of residuals, in units of the residual at which the weight becomes 0."""
    return np.where(np.abs(residuals) < 1, (1 - residuals**2) ** 2, 0)


def weighted_median(values: Array, weights: Array) -> float:
    """The value below which half of the weight lies."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def weighted_median_and_error(
    values: Array, weights: Array, independent: float
) -> tuple[float, float]:
    """The weighted median, and its standard error where so many of the values are independent."""
    middle = weighted_median(values, weights)
    scatter = ROBUST_DEVIATION * weighted_median(np.abs(values - middle), weights)
    return middle, float(MEDIAN_ERROR * scatter / np.sqrt(independent))
