"""SIFT keypoints and the matching of their descriptors, anywhere or near where they must be, for
frames of a track and for whole maps.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array

CONTRAST = 0.01
"""SIFT's threshold, a quarter of Lowe's 0.04: hazy frames have little contrast."""
AT_ONCE = 128
"""Descriptors compared with all of the other image: their distances stay in the cache."""

FeatureMatches = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Numbers of features of one image, and of those of the other that they match."""


def keypoints(
    contrast: NDArray[np.uint8], mask: NDArray[np.uint8], most: int
) -> tuple[Array, NDArray[np.float32]]:
    """Find the ``most`` strongest keypoints: (n, 2) pixels, (0, 0) the middle of the first, and (n,
    128) descriptors (Lowe 2004).

    contrast: (H, W) as ``local_contrast`` gives it. mask: (H, W), 0 where none is looked for.
    """
    sift = cv2.SIFT.create(most, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    found, descriptors = sift.detectAndCompute(contrast, mask)
    if not found:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([k.pt for k in found], np.float64), np.asarray(descriptors, np.float32)


def match_descriptors(
    a: NDArray[np.float32], b: NDArray[np.float32], ratio: float
) -> FeatureMatches:
    """Match descriptors a (n, 128) and b (m, 128): indices of those that are each other's nearest,
    and clearly nearer than the second nearest.

    ratio: Lowe's, of the two distances.
    """
    if min(len(a), len(b)) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    from_a = np.column_stack([-2 * a, (a * a).sum(1), np.ones(len(a), np.float32)])
    # one product gives squared distances
    from_b = np.column_stack([b, np.ones(len(b), np.float32), (b * b).sum(1)]).T
    nearest, least, second = np.zeros(len(a), np.int64), *np.zeros((2, len(a)), np.float32)
    least_of_b = np.full(len(b), np.inf, np.float32)
    for start in range(0, len(a), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        squared = from_a[part] @ from_b
        np.minimum(least_of_b, squared.min(axis=0), out=least_of_b)
        rows, best = np.arange(len(squared)), squared.argmin(axis=1)
        nearest[part], least[part] = best, squared[rows, best]
        squared[rows, best] = np.inf
        second[part] = squared.min(axis=1)
    chosen = np.flatnonzero((least < ratio**2 * second) & (least == least_of_b[nearest]))
    return chosen, nearest[chosen]
