"""The motion that most matched points agree on: RANSAC on triples, then least squares.

Both surveys are metric, so a triple whose sides differ is not a match: most wrong ones end there. A
scale is left to the least squares: each calibration is wrong by some thousandths or hundredths.
Fischler and Bolles 1981; Umeyama 1991; Horn 1987.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.resampling import jackknife
from calibration.transforms import rigid_alignment, scale_of, similarity_alignment
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class RansacSettings:
    """How the motion is searched."""

    triples: int = 200_000  # drawn; at one right match in twenty, 25 of them are right
    tried: int = 2_000  # of those whose sides agree
    together: int = 20  # of those: what their distances take fits into a cache
    refinements: int = 20  # of least squares on what agrees, which changes what agrees
    blocks: int = 6  # of ground, a side: left out one at a time for the scale's standard error


SETTINGS = RansacSettings()


@dataclass(frozen=True, eq=False)
class SimilarityFit:
    """T: (4, 4) from b to a, scale times rotation and a shift. inliers: (n,) bool. rms_m: of the
    inliers' distances. scale_std: standard error of the scale.
    """

    T: Array
    inliers: NDArray[np.bool_]
    rms_m: float
    scale_std: float


def similarity_fit(a: Array, b: Array, tolerance_m: float) -> SimilarityFit | None:
    """Fit the motion and scale of matched points (n, 3), of which those within tolerance_m agree;
    None where no three do.
    """
    triples = _alike_triples(a, b, tolerance_m)
    if not len(triples):
        return None
    motions = rigid_alignment(b[triples], a[triples])
    parts = np.array_split(motions, math.ceil(len(motions) / SETTINGS.together))
    agreeing = [(_distances(T, a, b) < tolerance_m).sum(axis=-1) for T in parts]
    T = motions[np.concatenate(agreeing).argmax()]
    for _ in range(SETTINGS.refinements):
        inliers = _distances(T, a, b) < tolerance_m
        if inliers.sum() < 3:
            return None
        T = similarity_alignment(b[inliers], a[inliers])
        if np.array_equal(_distances(T, a, b) < tolerance_m, inliers):
            break
    distances = _distances(T, a, b)
    inliers = distances < tolerance_m
    if inliers.sum() < 3:
        return None
    rms_m = float(np.sqrt((distances[inliers] ** 2).mean()))
    return SimilarityFit(T, inliers, rms_m, _scale_std(a[inliers], b[inliers]))


def _scale_std(a: Array, b: Array) -> float:
    """The standard error of the scale between points (n, 3) of a and b, by leaving out one block of
    ground at a time: errors of neighbors are alike.
    """
    low, most = a[:, :2].min(axis=0), SETTINGS.blocks
    span = np.maximum(np.ptp(a[:, :2], axis=0), 1e-9)
    place = np.minimum((a[:, :2] - low) / span * most, most - 1).astype(int)
    block = place[:, 0] * most + place[:, 1]
    others = [block != number for number in np.unique(block)]
    scales = np.array([scale_of(similarity_alignment(b[k], a[k])) for k in others if k.sum() >= 3])
    if len(scales) < 2:
        return float("inf")
    return float(jackknife(scales))


def _alike_triples(a: Array, b: Array, tolerance_m: float) -> NDArray[np.int64]:
    """(k, 3) numbers of matches whose triangles have the same sides, none of them short."""
    if len(a) < 3:
        return np.zeros((0, 3), np.int64)
    rng = np.random.default_rng(0)
    found = np.zeros((0, 3), np.int64)
    for triples in np.array_split(rng.integers(0, len(a), (SETTINGS.triples, 3)), 20):
        for i, j in ((0, 1), (1, 2), (2, 0)):
            side_a, side_b = (
                np.linalg.norm(points[triples[:, i]] - points[triples[:, j]], axis=1)
                for points in (a, b)
            )
            alike = (np.abs(side_a - side_b) < tolerance_m) & (side_a > 10 * tolerance_m)
            triples = triples[alike]
        found = np.concatenate([found, triples])
        if len(found) >= SETTINGS.tried:
            break
    return found[: SETTINGS.tried]


def _distances(T: Array, a: Array, b: Array) -> Array:
    """(..., n) of points (n, 3) of b, moved by (..., 4, 4), from those of a."""
    moved = b @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]
    return np.asarray(np.linalg.norm(moved - a, axis=-1))
