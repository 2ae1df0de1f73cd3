"""SIFT: keypoints, and the matching of their descriptors, anywhere or near where they must be."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled

# SIFT keypoints and the matching of their descriptors, for frames of a track and for whole maps.

CONTRAST = 0.01
"""SIFT's threshold, a quarter of Lowe's 0.04: hazy frames have little contrast."""
AT_ONCE = 128
"""Descriptors compared with all of the other image: their distances stay in the cache."""

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


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
) -> tuple[Integers, Integers]:
    """Match descriptors a (n, 128) and b (m, 128): indices of those that are each other's nearest,
    and clearly nearer than the second nearest.

    ratio: Lowe's, of the two distances.
    """
    if min(len(a), len(b)) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    from_a = np.column_stack([-2 * a, (a * a).sum(1), np.ones(len(a), np.float32)])
    from_b = np.column_stack(
        [b, np.ones(len(b), np.float32), (b * b).sum(1)]
    ).T  # one product gives squared distances
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


# Feature matching of two frames whose relative pose is roughly known: each feature is searched
# around its expected place alone.

Descriptors = NDArray[np.uint8]


def match_near(
    a: Descriptors, expected: Array, b: Descriptors, places: Array, reach: float, ratio: float
) -> tuple[Integers, Integers]:
    """Match features as ``match_descriptors`` does, but compare a feature of a (n, 128) only with
    those of b (m, 128) near its expected place.

    expected: (n, 2), NaN for features that b cannot show. places: (m, 2), within ``reach`` of that
    along both axes. A feature around whose place there is but one other matches none.
    """
    order = np.argsort(places[:, 0], kind="stable")
    sorted_places, sorted_b = np.ascontiguousarray(places[order]), np.ascontiguousarray(b[order])
    nearest, least, second = np.full(len(a), -1), np.full(len(a), np.inf), np.full(len(a), np.inf)
    least_of_b = np.full(len(b), np.inf)
    _compare_near(a, expected, sorted_b, sorted_places, reach, nearest, least, second, least_of_b)
    chosen = np.flatnonzero(
        np.isfinite(second) & (least < ratio**2 * second) & (least == least_of_b[nearest])
    )
    return chosen, order[nearest[chosen]]


@compiled
def _compare_near(
    a: Any,  # (n, 128) uint8
    expected: Any,  # (n, 2) float64
    b: Any,  # (m, 128) uint8
    places: Any,  # (m, 2) float64, by their first number
    reach: float,
    nearest: Any,  # (n,) int64, written: of b, for those of a that have one near
    least: Any,  # (n,) float64, written: squared distance to it
    second: Any,  # (n,) float64, written: to the second nearest
    least_of_b: Any,  # (m,) float64, written
) -> None:
    """Squared distances of all that are near each other."""
    for i in range(len(a)):
        x, y = expected[i]
        if not np.isfinite(x + y):
            continue
        first = np.searchsorted(places[:, 0], x - reach)
        for j in range(first, len(b)):
            if places[j, 0] > x + reach:
                break
            if abs(places[j, 1] - y) > reach:
                continue
            squared = np.int32(0)
            for k in range(128):
                off = np.int32(a[i, k]) - np.int32(b[j, k])
                squared += off * off
            if squared < least[i]:
                nearest[i], least[i], second[i] = j, squared, least[i]
            elif squared < second[i]:
                second[i] = squared
            least_of_b[j] = min(least_of_b[j], squared)
