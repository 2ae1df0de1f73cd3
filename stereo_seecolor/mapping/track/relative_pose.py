"""The relative pose of two frames, estimated from the points that both show."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.image_space import Moved, Observed, inverses, move
from stereo_seecolor.mapping.track.near_matches import match_near
from stereo_seecolor.mapping.track.sift import FeatureMatches, match_descriptors
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class RelativePoseSettings:
    """When two frames are taken to show the same, and how their relative pose is fitted."""

    ratio: float = 0.8  # Lowe's (2004) ratio of the nearest to the second nearest descriptor
    near_ratio: float = 0.65  # the same among the few that lie where a feature is expected
    # of the image's width: so far around the place where a known pose puts it a feature is looked
    # for
    reach: float = 0.05
    little: float = 0.25  # of a frame's features that another shows: too few are seldom found again
    min_inliers: int = 25  # fewer agree by chance, on repetitive bottoms
    min_inlier_fraction: float = 0.3  # of the matches
    # of the image's sides: points in one small corner, such as on one fish, hold no pose
    min_spread: float = 0.06
    ransac_rounds: int = 300  # finds 30 % inliers by triples with 99.97 % probability
    reprojection_px: float = 3.0  # RANSAC's inliers, pixels: ten standard errors of a feature
    outlier_sigmas: float = 4.0  # scale of the Cauchy kernel, and limit of an inlier afterwards
    near_sigmas: float = 5.0  # matches within so many of a first fit take part in the second
    rounds: int = 15  # of Gauss-Newton; it takes 5
    # added to the error of a turn: what calibration leaves at the image's borders
    systematic_rad: float = 5e-4
    systematic_m: float = 1e-3  # added to the error of a shift, meters


SETTINGS = RelativePoseSettings()


@dataclass(frozen=True, eq=False)
class Edge:
    """Two frames that see the same things.

    i, j: the frames. T_i_j: (4, 4), p_i = T_i_j p_j. covariance: (6, 6) of a turn (rad) and then a
    shift (m) of T_i_j, in the axes of j. inliers: the points that agree. loop: False between
    neighbors on the track.
    """

    i: int
    j: int
    T_i_j: Array
    covariance: Array
    inliers: int
    loop: bool = False

    @classmethod
    def of(
        cls, order: NDArray[np.int64], a: int, b: int, relation: "RelativePose", loop: bool = False
    ) -> "Edge":
        """The edge of a relation between two positions on the track; order: frames there."""
        T, covariance = relation.T_a_b, relation.covariance
        return cls(int(order[a]), int(order[b]), T, covariance, len(relation.index_a), loop)

    def scaled(self, scale: float) -> "Edge":
        """Scale all lengths by a factor."""
        T, covariance = _scaled(self.T_i_j, self.covariance, scale)
        return replace(self, T_i_j=T, covariance=covariance)


@dataclass(frozen=True, eq=False)
class RelativePose:
    """p_a = T_a_b p_b, with its covariance (6, 6); index_a, index_b: (n,) agreeing features."""

    T_a_b: Array
    covariance: Array
    index_a: NDArray[np.int32]
    index_b: NDArray[np.int32]

    def scaled(self, scale: float) -> "RelativePose":
        """Scale all lengths by a factor."""
        T, covariance = _scaled(self.T_a_b, self.covariance, scale)
        return replace(self, T_a_b=T, covariance=covariance)


class ExpectedPose(NamedTuple):
    """T_a_b (4, 4), roughly. sure: frames that show little in common by it are not compared as if
    nothing were known.
    """

    T_a_b: Array
    sure: bool = False


def _scaled(T: Array, covariance: Array, scale: float) -> tuple[Array, Array]:
    """A pose with its shift, and its covariance, scaled by this factor."""
    by = np.array([1, 1, 1, scale, scale, scale])
    T = T.copy()
    T[:3, 3] *= scale
    return T, np.asarray(covariance * by[:, None] * by)


def relative_pose(
    a: Features, b: Features, geometry: RectifiedPair, expected: ExpectedPose | None = None
) -> RelativePose | None:
    """The pose of frame b in frame a, or None where the two do not certainly see the same.

    Mutual nearest descriptors that pass Lowe's ratio test, PnP with RANSAC, then a fit in image
    space, each point weighted by the errors of both its measurements; a Cauchy kernel tames what is
    left of outliers. RANSAC believes the ranges of a: its inliers are those whose errors suit its
    pose, so those of the fit are chosen again from all matches.
    expected: features are looked for around their places by it first, which takes a tenth of the
    time.
    """
    if expected is not None:
        places = _places(expected.T_a_b, a, geometry)
        reach = SETTINGS.reach * geometry.image_size[0] / geometry.focal_px
        matches = match_near(
            a.descriptors, places, b.descriptors, b.points[:, :2], reach, SETTINGS.near_ratio
        )
        found = _fitted(a, b, matches, geometry)
        if found or (expected.sure and np.isfinite(places[:, 0]).mean() < SETTINGS.little):
            return found
    matches = match_descriptors(
        a.descriptors.astype(np.float32), b.descriptors.astype(np.float32), SETTINGS.ratio
    )
    return _fitted(a, b, matches, geometry)


def _places(T_a_b: Array, a: Features, geometry: RectifiedPair) -> Array:
    """(n, 2) where frame b shows the features of a, x / z and y / z; NaN outside of its image."""
    T = inverse(T_a_b)
    rays = (
        np.column_stack([a.points[:, :2], np.ones(len(a.points))]) @ T[:3, :3].T
        + a.points[:, 2:] * T[:3, 3]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        places = rays[:, :2] / rays[:, 2:]
        pixels = places * geometry.focal_px + [geometry.cx_left_px, geometry.cy_px]
    inside = (
        (rays[:, 2] > 0) & (pixels > 0).all(axis=1) & (pixels < geometry.image_size).all(axis=1)
    )
    return np.where(inside[:, None], places, np.nan)


def _fitted(
    a: Features, b: Features, matches: FeatureMatches, geometry: RectifiedPair
) -> RelativePose | None:
    """By matches, of which many may be wrong."""
    index_a, index_b = matches
    start = _ransac(a, b, matches, geometry)
    if start is None:
        return None
    T, first = start
    seen_a = Observed(a.points[index_a], a.std[index_a])
    seen_b = Observed(b.points[index_b], b.std[index_b])
    try:
        T = fit_pose(T, seen_a.chosen(first), seen_b.chosen(first))[0]
        near = np.flatnonzero(squared_sigmas(T, seen_a, seen_b) < SETTINGS.near_sigmas**2)
        T, covariance, kept = fit_pose(T, seen_a.chosen(near), seen_b.chosen(near))
    except np.linalg.LinAlgError:  # all points on a line
        return None
    kept = near[kept]
    if len(kept) < SETTINGS.min_inliers or not _spread_out(seen_b.points[kept], geometry):
        return None
    # int32: a dive holds millions
    return RelativePose(
        T, covariance, index_a[kept].astype(np.int32), index_b[kept].astype(np.int32)
    )


def fit_pose(T: Array, a: Observed, b: Observed) -> tuple[Array, Array, NDArray[np.int64]]:
    """Maximum likelihood of T_a_b (4, 4) from a first guess, given both measurements of n points;
    its covariance (6, 6); and which points are within four sigmas. Raises LinAlgError for points
    that hold no pose.
    """
    for _ in range(SETTINGS.rounds):
        squared, H, g = residuals(T, a, b)
        step = np.asarray(np.linalg.solve(H, g), np.float64)
        T = T @ rigid_transform(rotation_from_vector(step[:3]), step[3:])
        if np.abs(step).max() < 1e-7:
            break
    kept = np.flatnonzero(squared < SETTINGS.outlier_sigmas**2)
    scale = max(1.0, float(squared[kept].sum()) / max(3 * len(kept) - 6, 1)) if len(kept) else 1.0
    systematic = np.diag([SETTINGS.systematic_rad**2] * 3 + [SETTINGS.systematic_m**2] * 3)
    return T, np.asarray(np.linalg.inv(H) * scale + systematic, np.float64), kept


def squared_sigmas(T: Array, a: Observed, b: Observed) -> Array:
    """Squared distances of matches in standard errors: (n,), infinite behind the camera."""
    scaled_depth = b.points @ T[2, [0, 1, 3]] + T[2, 2]
    return np.where(scaled_depth * b.points[:, 2] > 0, weighed(move(T, b.points), a, b)[2], np.inf)


def residuals(T: Array, a: Observed, b: Observed) -> tuple[Array, Array, Array]:
    """Compute (n,) residuals in standard errors, squared, and the normal equations (6, 6), (6,) of
    a step of the pose: each point weighted by both its errors, under a Cauchy kernel.
    """
    moved = move(T, b.points)
    weight, pull, squared = weighed(moved, a, b)
    robust = 1 / (1 + squared / SETTINGS.outlier_sigmas**2)
    weighted = ((robust[:, None, None] * weight) @ moved.by_pose).reshape(-1, 6)
    rows = moved.by_pose.reshape(-1, 6)
    return squared, rows.T @ weighted, rows.T @ (robust[:, None] * pull).ravel()


def weighed(moved: Moved, a: Observed, b: Observed) -> tuple[Array, Array, Array]:
    """(n, 3, 3) the inverse covariance of the difference between points of a and the moved ones of
    b; (n, 3) that times the difference; (n,) its square in standard errors.
    """
    weight = inverse_covariance(moved, a, b)
    return weight, *pulled(weight, a.points - moved.points)


def inverse_covariance(moved: Moved, a: Observed, b: Observed) -> Array:
    """(n, 3, 3), of the difference between points of a and the moved ones of b."""
    spread = moved.by_point * b.std[:, None, :]
    covariance = spread @ spread.transpose(0, 2, 1)
    covariance[:, range(3), range(3)] += a.std**2
    return inverses(covariance)


def pulled(weight: Array, residual: Array) -> tuple[Array, Array]:
    """(n, 3) residuals times their weights (n, 3, 3); (n,) their squares in standard errors."""
    pull = (weight @ residual[:, :, None])[:, :, 0]
    return pull, (residual * pull).sum(axis=1)


def _ransac(
    a: Features, b: Features, matches: FeatureMatches, geometry: RectifiedPair
) -> tuple[Array, NDArray[np.int64]] | None:
    """T_a_b and which of the matches agree with it; None for too few."""
    index_a, index_b = matches
    if len(index_a) < SETTINGS.min_inliers:
        return None
    pixels = b.points[index_b, :2] * geometry.focal_px
    K = np.diag([geometry.focal_px, geometry.focal_px, 1.0])
    found, turn, shift, inliers = cv2.solvePnPRansac(
        a.points_m[index_a], pixels, K, None, iterationsCount=SETTINGS.ransac_rounds,
        reprojectionError=SETTINGS.reprojection_px, confidence=0.9999, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    needed = max(SETTINGS.min_inliers, SETTINGS.min_inlier_fraction * len(index_a))
    if not found or inliers is None or len(inliers) < needed:
        return None
    return inverse(
        rigid_transform(rotation_from_vector(turn.ravel()), shift.ravel())
    ), inliers.ravel().astype(np.int64)


def _spread_out(points: Array, geometry: RectifiedPair) -> bool:
    least = SETTINGS.min_spread * np.array(geometry.image_size) / geometry.focal_px
    return bool((points[:, :2].std(axis=0) > least).all())
