"""How one frame stands to another, from what both show."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.geometry import inverse, rotation_from_vector
from stereo_seecolor.mapping.track.features import Features

MIN_INLIERS = 25
MIN_INLIER_SHARE = 0.3
MIN_SPREAD = 0.06
RATIO = 0.8
REPROJECTION_PX = 3.0
OUTLIER_SIGMAS = 4.0
SYSTEMATIC_RAD = 5e-4
SYSTEMATIC_M = 1e-3


@dataclass(frozen=True, eq=False)
class Edge:
    """Two frames that see the same things.

    i, j: the frames. T_i_j: (4, 4), p_i = T_i_j p_j. covariance: (6, 6) of a turn (rad) and then a shift (m) of T_i_j, in the
    axes of j. inliers: the points that agree.
    """

    i: int
    j: int
    T_i_j: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: int


def relate(i: int, a: Features, j: int, b: Features, pair: RectifiedPair) -> Edge | None:
    """The pose of frame j in frame i, or None where the two do not certainly see the same.

    Mutual nearest descriptors that pass Lowe's ratio test, PnP with RANSAC, then all inliers by Gauss-Newton, each point
    weighted by the covariance of both its measurements; a Cauchy kernel tames what is left of outliers.
    """
    index_a, index_b = _matches(a, b)
    if len(index_a) < MIN_INLIERS:
        return None
    found, turn, shift, inliers = cv2.solvePnPRansac(
        a.points_m[index_a], b.pixels[index_b], pair.P_left, None,
        iterationsCount=300, reprojectionError=REPROJECTION_PX, confidence=0.9999, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not found or inliers is None or len(inliers) < max(MIN_INLIERS, MIN_INLIER_SHARE * len(index_a)):
        return None
    T_b_a = np.eye(4)
    T_b_a[:3, :3], T_b_a[:3, 3] = rotation_from_vector(turn.ravel()), shift.ravel()
    chosen_a, chosen_b = index_a[inliers.ravel()], index_b[inliers.ravel()]
    try:
        T_a_b, covariance, kept = _refine(inverse(T_b_a), a, chosen_a, b, chosen_b)
    except np.linalg.LinAlgError:  # all points on a line
        return None
    if kept.sum() < MIN_INLIERS or not _spread_out(b.pixels[chosen_b[kept]], pair):
        return None
    return Edge(i, j, T_a_b, covariance, int(kept.sum()))


def _matches(a: Features, b: Features) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of mutual nearest neighbors that are clearly nearer than the second."""
    if len(a.descriptors) < 2 or len(b.descriptors) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    x, y = a.descriptors.astype(np.float32), b.descriptors.astype(np.float32)
    squared = (x * x).sum(1)[:, None] + (y * y).sum(1)[None] - 2 * x @ y.T
    nearest = squared.argmin(axis=1)
    mutual = squared.argmin(axis=0)[nearest] == np.arange(len(x))
    two = np.partition(squared, 1, axis=1)[:, :2]
    clear = two[:, 0] < RATIO**2 * two[:, 1]
    chosen = np.flatnonzero(mutual & clear)
    return chosen, nearest[chosen]


def _refine(
    T: NDArray[np.float64], a: Features, index_a: NDArray[np.int64], b: Features, index_b: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Maximum likelihood of T_a_b given both measurements of each point; its covariance; who is within four sigmas."""
    p, q = a.points_m[index_a], b.points_m[index_b]
    for _ in range(15):
        R = T[:3, :3]
        residual = p - (q @ R.T + T[:3, 3])
        weight = np.linalg.inv(a.covariance_m2[index_a] + R @ b.covariance_m2[index_b] @ R.T)
        squared = np.einsum("ni,nij,nj->n", residual, weight, residual)
        J = np.concatenate([-R @ _cross(q), np.broadcast_to(R, (len(q), 3, 3))], axis=2)
        robust = weight / (1 + squared / OUTLIER_SIGMAS**2)[:, None, None]
        H = np.einsum("nki,nkl,nlj->ij", J, robust, J)
        step = np.linalg.solve(H, np.einsum("nki,nkl,nl->i", J, robust, residual))
        update = np.eye(4)
        update[:3, :3], update[:3, 3] = rotation_from_vector(step[:3]), step[3:]
        T = T @ update
        if np.abs(step).max() < 1e-7:
            break
    kept = squared < OUTLIER_SIGMAS**2
    scale = max(1.0, float(squared[kept].sum()) / max(3 * int(kept.sum()) - 6, 1)) if kept.any() else 1.0
    systematic = np.diag([SYSTEMATIC_RAD**2] * 3 + [SYSTEMATIC_M**2] * 3)
    return T, np.linalg.inv(H) * scale + systematic, kept


def _cross(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 3) cross product matrices."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)


def _spread_out(pixels: NDArray[np.float64], pair: RectifiedPair) -> bool:
    """Points in one small corner, such as on one fish, hold no pose."""
    return bool((pixels.std(axis=0) > MIN_SPREAD * np.array(pair.image_size)).all())
