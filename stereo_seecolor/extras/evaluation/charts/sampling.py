"""Samples an image between its pixels, and correlates colors."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array

_NOTHING = 1e-9
"""Spread of values that is only rounding."""


def sampled(picture: NDArray[np.float32], pixels: Array) -> Array:
    """(K, N, 3) at pixels (K, N, 2), between pixels by bilinear interpolation; NaN outside."""
    x, y = (np.ascontiguousarray(pixels[..., axis], np.float32) for axis in (0, 1))
    found: Any = cv2.remap(
        picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,) * 3
    )
    return np.asarray(found, np.float64)


def correlations(values: Array, reference: Array) -> Array:
    """(K, 3) correlation of values (K, N, 3) with a reference (N, 3), by channel; -1 where values
    are NaN or do not vary.
    """
    b = reference - reference.mean(axis=0)
    products = np.einsum("knc,nc->kc", values, b)
    sums = np.ones(values.shape[1]) @ values  # several times faster than values.sum(axis=1)
    spread = np.einsum("knc,knc->kc", values, values) - sums**2 / values.shape[1]
    norms = np.sqrt(np.maximum(spread, 0) * (b * b).sum(axis=0))
    return np.where(norms > _NOTHING, products / np.maximum(norms, _NOTHING), -1.0)
