"""The pose of one frame relative to another, from what both show."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.geometry import inverse, pose, rotation_from_vector
from stereo_seecolor.mapping.track.features import Features

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RelativePoseSettings:
    """When two frames are taken to see the same, and how their pose is fitted."""

    ratio: float = 0.8  # Lowe's (2004) ratio of the nearest to the second nearest descriptor
    min_inliers: int = 25  # fewer agree by chance, on repetitive bottoms
    min_inlier_fraction: float = 0.3  # of the matches
    min_spread: float = 0.06  # of the image's sides: points in one small corner, such as on one fish, hold no pose
    ransac_rounds: int = 300  # finds 30 % inliers by triples with 99.97 % probability
    reprojection_px: float = 3.0  # RANSAC's inliers, pixels: ten standard errors of a feature
    outlier_sigmas: float = 4.0  # scale of the Cauchy kernel, and limit of an inlier afterwards
    rounds: int = 15  # of Gauss-Newton; it takes 5
    systematic_rad: float = 5e-4  # added to the error of a turn: what calibration leaves at the image's borders
    systematic_m: float = 1e-3  # added to the error of a shift, meters


SETTINGS = RelativePoseSettings()


@dataclass(frozen=True, eq=False)
class Edge:
    """Two frames that see the same things.

    i, j: the frames. T_i_j: (4, 4), p_i = T_i_j p_j. covariance: (6, 6) of a turn (rad) and then a shift (m) of T_i_j, in the
    axes of j. inliers: the points that agree. loop: False between neighbors on the track.
    """

    i: int
    j: int
    T_i_j: Array
    covariance: Array
    inliers: int
    loop: bool = False


@dataclass(frozen=True, eq=False)
class RelativePose:
    """p_a = T_a_b p_b, with its covariance (6, 6) as an Edge has it, and how many points agree."""

    T_a_b: Array
    covariance: Array
    inliers: int


def relative_pose(a: Features, b: Features, geometry: RectifiedPair) -> RelativePose | None:
    """The pose of frame b in frame a, or None where the two do not certainly see the same.

    Mutual nearest descriptors that pass Lowe's ratio test, PnP with RANSAC, then all inliers by Gauss-Newton, each point
    weighted by the covariance of both its measurements; a Cauchy kernel tames what is left of outliers.
    """
    index_a, index_b = _matches(a, b)
    if len(index_a) < SETTINGS.min_inliers:
        return None
    found, turn, shift, inliers = cv2.solvePnPRansac(
        a.points_m[index_a], b.pixels[index_b], geometry.P_left, None, iterationsCount=SETTINGS.ransac_rounds,
        reprojectionError=SETTINGS.reprojection_px, confidence=0.9999, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    needed = max(SETTINGS.min_inliers, SETTINGS.min_inlier_fraction * len(index_a))
    if not found or inliers is None or len(inliers) < needed:
        return None
    T_b_a = pose(rotation_from_vector(turn.ravel()), shift.ravel())
    chosen_a, chosen_b = index_a[inliers.ravel()], index_b[inliers.ravel()]
    try:
        T_a_b, covariance, kept = _refine(inverse(T_b_a), (a, chosen_a), (b, chosen_b))
    except np.linalg.LinAlgError:  # all points on a line
        return None
    if kept.sum() < SETTINGS.min_inliers or not _spread_out(b.pixels[chosen_b[kept]], geometry):
        return None
    return RelativePose(T_a_b, covariance, int(kept.sum()))


def _matches(a: Features, b: Features) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of mutual nearest neighbors that are clearly nearer than the second."""
    if len(a.descriptors) < 2 or len(b.descriptors) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    x, y = a.descriptors.astype(np.float32), b.descriptors.astype(np.float32)
    squared = (x * x).sum(1)[:, None] + (y * y).sum(1)[None] - 2 * x @ y.T
    nearest = squared.argmin(axis=1)
    mutual = squared.argmin(axis=0)[nearest] == np.arange(len(x))
    two = np.partition(squared, 1, axis=1)[:, :2]
    clear = two[:, 0] < SETTINGS.ratio**2 * two[:, 1]
    chosen = np.flatnonzero(mutual & clear)
    return chosen, nearest[chosen]


Points = tuple[Features, NDArray[np.int64]]
"""Features, and which of them."""


def _refine(T: Array, a: Points, b: Points) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Maximum likelihood of T_a_b given both measurements of each point; its covariance; which are within four sigmas."""
    p, q = a[0].points_m[a[1]], b[0].points_m[b[1]]
    covariance_p, covariance_q = a[0].covariance_m2(a[1]), b[0].covariance_m2(b[1])
    for _ in range(SETTINGS.rounds):
        R = T[:3, :3]
        residual = p - (q @ R.T + T[:3, 3])
        weight = np.linalg.inv(covariance_p + R @ covariance_q @ R.T)
        squared = np.einsum("ni,nij,nj->n", residual, weight, residual)
        J = np.concatenate([-R @ _cross(q), np.broadcast_to(R, (len(q), 3, 3))], axis=2)
        robust = weight / (1 + squared / SETTINGS.outlier_sigmas**2)[:, None, None]
        H = np.einsum("nki,nkl,nlj->ij", J, robust, J)
        step = np.linalg.solve(H, np.einsum("nki,nkl,nl->i", J, robust, residual))
        T = T @ pose(rotation_from_vector(step[:3]), step[3:])
        if np.abs(step).max() < 1e-7:
            break
    kept = squared < SETTINGS.outlier_sigmas**2
    scale = max(1.0, float(squared[kept].sum()) / max(3 * int(kept.sum()) - 6, 1)) if kept.any() else 1.0
    systematic = np.diag([SETTINGS.systematic_rad**2] * 3 + [SETTINGS.systematic_m**2] * 3)
    return T, np.linalg.inv(H) * scale + systematic, kept


def _cross(v: Array) -> Array:
    """(n, 3, 3) cross product matrices."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)


def _spread_out(pixels: Array, geometry: RectifiedPair) -> bool:
    return bool((pixels.std(axis=0) > SETTINGS.min_spread * np.array(geometry.image_size)).all())
