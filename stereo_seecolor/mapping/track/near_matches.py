"""Feature matching of frames of roughly known relative pose, around expected places alone."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.track.sift import FeatureMatches
from stereo_seecolor.records import Array

Descriptors = NDArray[np.uint8]


def match_near(
    a: Descriptors, expected: Array, b: Descriptors, places: Array, reach: float, ratio: float
) -> FeatureMatches:
    """Match features as ``match_descriptors`` does, but compare a feature of a (n, 128) only with
    those of b (m, 128) near its expected place.

    expected: (n, 2), NaN for features that b cannot show. places: (m, 2), within ``reach`` of that
    along both axes. A feature around whose place there is but one other matches none.
    """
    order = np.argsort(places[:, 0], kind="stable")
    sorted_places, sorted_b = np.ascontiguousarray(places[order]), np.ascontiguousarray(b[order])
    nearest, least, second = np.full(len(a), -1), np.full(len(a), np.inf), np.full(len(a), np.inf)
    least_of_b = np.full(len(b), np.inf)
    first = np.searchsorted(sorted_places[:, 0], expected[:, 0] - reach)
    _compare_near(
        a, expected, sorted_b, sorted_places, first, reach, nearest, least, second, least_of_b
    )
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
    first: Any,  # (n,) int64, of ``places``, the first that may be near
    reach: float,
    nearest: Any,  # (n,) int64, written: of b, for those of a that have one near
    least: Any,  # (n,) float64, written: squared distance to it
    second: Any,  # (n,) float64, written: to the second nearest
    least_of_b: Any,  # (m,) float64, written
) -> None:
    """Squared distances of all that are near each other."""
    for i in range(len(a)):
        x, y = expected[i, 0], expected[i, 1]
        if not np.isfinite(x + y):
            continue
        for j in range(first[i], len(b)):
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
