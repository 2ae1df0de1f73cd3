"""Points in image space, x / z, y / z and 1 / z, under a rigid motion: a projective map, in which
errors of stereo are symmetric.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array


@dataclass(frozen=True, eq=False)
class Observed:
    """Observed points: (n, 3) in image space, 1 / z in 1/m. std: (n, 3) their standard errors."""

    points: Array
    std: Array

    def chosen(self, which: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "Observed":
        """Select some points."""
        return Observed(self.points[which], self.std[which])


@dataclass(frozen=True, eq=False)
class Moved:
    """Points seen from another camera.

    points: (n, 3) in that camera. by_point: (n, 3, 3) and by_pose: (n, 3, 6) their derivatives, by
    the points as they were, and by a turn (rad) and a shift (m) in the axes of the camera that they
    come from.
    """

    points: Array
    by_point: Array
    by_pose: Array


def move(T: Array, points: Array) -> Moved:
    """Points (n, 3) of one camera as the other sees them; T: (4, 4) to the other camera (Demirdjian
    and Darrell 2001).
    """
    R, shift = T[:3, :3], T[:3, 3]
    rays, inverse = np.column_stack([points[:, :2], np.ones(len(points))]), points[:, 2:]
    scaled = rays @ R.T + inverse * shift
    depth = scaled[:, 2:]
    moved = np.column_stack([scaled[:, :2], points[:, 2]]) / depth
    by_point = np.broadcast_to(np.column_stack([R[:, 0], R[:, 1], shift]), (len(points), 3, 3))
    by_pose = np.concatenate([-R @ cross(rays), inverse[:, :, None] * R], axis=2)
    by_own = np.zeros((3, 3))
    by_own[2, 2] = 1  # 1 / z itself
    return Moved(
        moved,
        _divided(by_point, moved, depth) + by_own / depth[:, :, None],
        _divided(by_pose, moved, depth),
    )


def _divided(derivative: Array, moved: Array, depth: Array) -> Array:
    """Of scaled rays, (n, 3, k), to that of points in image space, but for 1 / z itself."""
    rows = np.concatenate([derivative[:, :2], np.zeros_like(derivative[:, 2:])], axis=1)
    return np.asarray((rows - moved[:, :, None] * derivative[:, 2:]) / depth[:, :, None])


def from_plane(points: Array) -> Array:
    """(n,) 1 / z of points (n, 3) less that of the plane through them (least squares)."""
    plane = np.column_stack([points[:, :2], np.ones(len(points))])
    return np.asarray(points[:, 2] - plane @ np.linalg.lstsq(plane, points[:, 2])[0])


def cross(v: Array) -> Array:
    """Make the cross product matrices of vectors: (n, 3, 3)."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)],
        axis=-2,
    )


def inverses(V: Array) -> Array:
    """Invert symmetric matrices (m, 3, 3); zeros where one has no inverse that is positive."""
    a, b, c, d, e, f = (V[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    adjugate = np.stack(
        [d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b]
    )
    determinant = a * adjugate[0] + b * adjugate[1] + c * adjugate[2]
    found = np.where(determinant > 0, adjugate / np.where(determinant > 0, determinant, 1.0), 0.0)
    return np.asarray(found[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3))
