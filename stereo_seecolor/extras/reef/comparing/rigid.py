"""The rigid motion that most matched points agree on: RANSAC on triples, then least squares on the inliers.

Both surveys are metric, so there is no scale to find, and a triple whose sides differ is no match: most wrong ones end there.
Fischler and Bolles 1981; Umeyama 1991.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.geometry import rigid_alignment, transformed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RansacSettings:
    """How the motion is searched."""

    triples: int = 200_000  # drawn; at one right match in twenty, 25 of them are right
    tried: int = 2_000  # of those whose sides agree
    refinements: int = 5  # of least squares on what agrees, which changes what agrees


SETTINGS = RansacSettings()


@dataclass(frozen=True, eq=False)
class RigidFit:
    """T: (4, 4) from b to a. inliers: (n,) bool. rms_m: of the inliers' distances."""

    T: Array
    inliers: NDArray[np.bool_]
    rms_m: float


def rigid_fit(a: Array, b: Array, tolerance_m: float) -> RigidFit | None:
    """Fit the rigid motion of matched points (n, 3), of which those within tolerance_m agree; None where no three do."""
    best: tuple[int, Array] | None = None
    for triple in _alike_triples(a, b, tolerance_m):
        T = rigid_alignment(b[triple], a[triple])
        agree = int((_distances(T, a, b) < tolerance_m).sum())
        if best is None or agree > best[0]:
            best = agree, T
    if best is None:
        return None
    T = best[1]
    for _ in range(SETTINGS.refinements):
        inliers = _distances(T, a, b) < tolerance_m
        if inliers.sum() < 3:
            return None
        T = rigid_alignment(b[inliers], a[inliers])
    distances = _distances(T, a, b)
    inliers = distances < tolerance_m
    return RigidFit(T, inliers, float(np.sqrt((distances[inliers] ** 2).mean()))) if inliers.sum() >= 3 else None


def _alike_triples(a: Array, b: Array, tolerance_m: float) -> NDArray[np.int64]:
    """(k, 3) numbers of matches whose triangles have the same sides, none of them short."""
    if len(a) < 3:
        return np.zeros((0, 3), np.int64)
    rng = np.random.default_rng(0)
    triples = rng.integers(0, len(a), (SETTINGS.triples, 3))
    alike = np.ones(len(triples), bool)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        side_a, side_b = (np.linalg.norm(points[triples[:, i]] - points[triples[:, j]], axis=1) for points in (a, b))
        alike &= (np.abs(side_a - side_b) < tolerance_m) & (side_a > 10 * tolerance_m)
    return np.asarray(triples[alike][: SETTINGS.tried])


def _distances(T: Array, a: Array, b: Array) -> Array:
    return np.asarray(np.linalg.norm(transformed(T, b) - a, axis=1))
