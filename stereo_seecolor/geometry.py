"""Rigid transforms as (..., 4, 4) matrices, and rotations; and the standard error of ranges.

scipy.spatial takes as long to import as a pair to match, so that only the functions that need it
import it.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.geometry import RectifiedPair

Array = NDArray[np.float64]
Map = NDArray[np.float32]

DISPARITY_STD_PX = 0.1
"""Standard error of a disparity, pixels: the median that the matcher states on the sample dive is
0.09.
"""

_LEAST_QUATERNION = 1e-300
"""Smaller numbers cannot be divided by."""


R_ENU_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
"""From axes north, east, down to east, north, up."""


def pose(R: ArrayLike, position_m: ArrayLike) -> Array:
    """The rigid transforms (..., 4, 4) of rotations (..., 3, 3) and positions (..., 3)."""
    R, position_m = np.asarray(R, np.float64), np.asarray(position_m, np.float64)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], position_m.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, position_m, 1
    return T


def inverse(T: Array) -> Array:
    """The inverse of rigid transforms, (..., 4, 4)."""
    result = np.zeros_like(T)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = R
    result[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1
    return result


def transform_points(T: Array, points: NDArray[np.floating]) -> Array:
    """Points (..., 3) through a rigid transform (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3], np.float64)


def rotation_vector(R: Array) -> Array:
    """(..., 3) axis times angle of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_rotvec()


def rotation_from_vector(vector: Array) -> Array:
    """(..., 3, 3) rotations of axis times angle (..., 3), by Rodrigues' formula, in forms that hold
    for an angle of zero.
    """
    vector = np.asarray(vector, np.float64)
    x, y, z = np.moveaxis(vector, -1, 0)
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(
        *vector.shape[:-1], 3, 3
    )
    turns = np.linalg.norm(vector, axis=-1)[..., None, None] / np.pi
    return np.asarray(
        np.eye(3) + np.sinc(turns) * cross + 0.5 * np.sinc(turns / 2) ** 2 * (cross @ cross),
        np.float64,
    )


def quaternion(R: Array) -> Array:
    """(..., 4) as x, y, z, w with w >= 0, of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat(canonical=True)


def rotation_from_quaternion(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Convert quaternions (N, 4), x, y, z, w, to rotations (N, 3, 3); they are normalized first,
    NaN where zero or not finite.
    """
    from scipy.spatial.transform import Rotation

    q = np.atleast_2d(np.asarray(quaternion, dtype=np.float64))
    R = np.full((len(q), 3, 3), np.nan)
    known = np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1) > _LEAST_QUATERNION)
    if known.any():
        # squares of huge numbers would overflow
        scaled = q[known] / np.abs(q[known]).max(axis=1, keepdims=True)
        R[known] = Rotation.from_quat(scaled).as_matrix()
    return R


def interpolate(before: Array, after: Array, fraction: Array) -> Array:
    """The poses (N, 4, 4) at fractions (N,) of the way between two: on a straight line, with
    constant angular velocity.
    """
    T = before.copy()
    turn = rotation_vector(np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3])
    part = np.asarray(fraction)[:, None]
    T[:, :3, :3] = before[:, :3, :3] @ rotation_from_vector(part * turn)
    T[:, :3, 3] = (1 - part) * before[:, :3, 3] + part * after[:, :3, 3]
    return T


def estimated_range_std_m(range_m: Map, geometry: RectifiedPair) -> Map:
    """Standard error of ranges (H, W) whose own is not known: range depth std / (f B), with
    DISPARITY_STD_PX as std.
    """
    depth_m = range_m / geometry.ray_length
    scale = np.float32(DISPARITY_STD_PX / (geometry.focal_px * geometry.baseline_m))
    return (range_m * depth_m * scale).astype(np.float32)


def rotation_to_z(direction: Array) -> Array:
    """The rotation (3, 3) by the smallest angle that takes ``direction`` (3,) to +z."""
    unit = direction / np.linalg.norm(direction)
    axis = np.cross(unit, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(unit[2])
    if sine < 1e-12:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_from_vector(axis / sine * np.arctan2(sine, cosine))


def rigid_alignment(points: Array, targets: Array) -> Array:
    """The rigid transforms (..., 4, 4), without scale, that take points (..., N, 3) nearest to
    their targets (..., N, 3).

    Umeyama 1991, Least-squares estimation of transformation parameters, IEEE PAMI 13(4), eqs. 40 to
    43 with c = 1.
    """
    center, target = points.mean(axis=-2), targets.mean(axis=-2)
    apart = np.swapaxes(targets - target[..., None, :], -1, -2)
    R = nearest_rotation(apart @ (points - center[..., None, :]))
    return pose(R, target - (R @ center[..., None])[..., 0])


def similarity_alignment(points: Array, targets: Array) -> Array:
    """The similarity (4, 4), its first three columns scale times rotation, that takes points (N, 3)
    nearest to their targets (N, 3).

    The scale is symmetric in both, so that errors of neither shorten it: Horn 1987, Closed-form
    solution of absolute orientation using unit quaternions, JOSA A 4(4), section 2.E.
    """
    T = rigid_alignment(points, targets)
    center, target = points.mean(axis=0), targets.mean(axis=0)
    sizes = float(np.linalg.norm(targets - target)), float(np.linalg.norm(points - center))
    T[:3, :3] *= sizes[0] / max(sizes[1], 1e-12)
    T[:3, 3] = target - T[:3, :3] @ center
    return T


def scale_of(T: Array) -> float:
    """The scale of a similarity (4, 4)."""
    return float(np.cbrt(np.linalg.det(T[:3, :3])))


def nearest_rotation(M: Array) -> Array:
    """The rotations (..., 3, 3) nearest to any matrices (..., 3, 3), by their singular value
    decompositions.
    """
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return np.asarray(U @ Vt)
