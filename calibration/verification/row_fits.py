"""Robust fits of the vertical disparity over the image: offset, scale and roll; outliers."""

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import Array, RectifiedPair
from calibration.robust_statistics import deviation_about_zero


def row_inliers(left: Array, right: Array, pair: RectifiedPair) -> NDArray[np.bool_]:
    """Matches within a few deviations of a smooth trend of row differences over the image."""
    x, y = ((left - np.array(pair.image_size) / 2) / pair.focal_px).T
    disparity = (left[:, 0] - right[:, 0]) / pair.focal_px
    one = np.ones_like(x)
    terms = np.column_stack([one, x, y, x * y, y**2, x**2 * y, y**3, x * y * disparity])
    _, rest = robust_fit(terms, right[:, 1] - left[:, 1])
    return np.abs(rest) < max(4 * deviation_about_zero(rest), 0.3)


def explain(rows: Array, offsets: Array) -> tuple[Array, Array]:
    """Fit offset, scale and roll (radians) to rows; return these and the residuals. offsets: (n, 2)
    pixels from the middle.
    """
    return robust_fit(np.column_stack([np.ones(len(rows)), offsets[:, 1], offsets[:, 0]]), rows)


def robust_fit(terms: Array, values: Array) -> tuple[Array, Array]:
    """Fit by least absolute deviations, reweighted; return coefficients and residuals."""
    weights = np.ones(len(values))
    sizes = np.maximum(np.linalg.norm(terms, axis=0), 1e-12)
    scaled = terms / sizes
    for _ in range(15):
        weighted = scaled * weights[:, None]
        # normal equations: a tenth of the time of a fit to all rows
        found = np.linalg.lstsq(scaled.T @ weighted, weighted.T @ values, rcond=None)[0]
        rest = values - scaled @ found
        weights = 1 / np.maximum(np.abs(rest), 0.05)
    return np.asarray(found / sizes), rest
