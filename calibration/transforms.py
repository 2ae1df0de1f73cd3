"""Rigid transforms as (..., 4, 4) matrices, p_target = T_target_source @ p_source, and rotations.

scipy.spatial takes as long to import as a pair to match: only functions that need it import it.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_LEAST_QUATERNION = 1e-300
"""Smaller numbers cannot be divided by."""


def rigid_transform(R: ArrayLike, translation: ArrayLike) -> Array:
    """The rigid transforms (..., 4, 4) of rotations (..., 3, 3) and translations (..., 3)."""
    R, translation = np.asarray(R, np.float64), np.asarray(translation, np.float64)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], translation.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, translation, 1
    return T


def inverse(T: Array) -> Array:
    """The inverse of rigid transforms, (..., 4, 4)."""
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    return rigid_transform(R, -(R @ T[..., :3, 3:])[..., 0])


def transform_points(T: Array, points: NDArray[np.floating]) -> Array:
    """Points (..., 3) through a rigid transform (4, 4)."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3], np.float64)


def rotation_vector(R: Array) -> Array:
    """(..., 3) axis times angle of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_rotvec()


def rotation_from_vector(vector: Array) -> Array:
    """(..., 3, 3) rotations of axis times angle (..., 3), by Rodrigues' formula, zero included."""
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


def rotation_from_euler(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """(..., 3, 3) Rz(yaw) Ry(pitch) Rx(roll), radians: body axes to the axes of the angles."""
    angles = np.broadcast_arrays(roll, pitch, yaw)
    (cx, sx), (cy, sy), (cz, sz) = ((np.cos(angle), np.sin(angle)) for angle in angles)
    one, none = np.ones_like(cx), np.zeros_like(cx)
    about_x, about_y, about_z = (
        np.stack(rows, axis=-1).reshape(*cx.shape, 3, 3)
        for rows in (
            (one, none, none, none, cx, -sx, none, sx, cx),
            (cy, none, sy, none, one, none, -sy, none, cy),
            (cz, -sz, none, sz, cz, none, none, none, one),
        )
    )
    return np.asarray(about_z @ about_y @ about_x, np.float64)


def quaternion(R: Array) -> Array:
    """(..., 4) as x, y, z, w with w >= 0, of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat(canonical=True)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """(..., 3, 3) rotations of quaternions (..., 4), x, y, z, w, of any length; else NaN."""
    q = np.asarray(quaternion, np.float64)
    largest = np.abs(q).max(axis=-1, keepdims=True)
    q = q / np.where((largest > _LEAST_QUATERNION) & (largest < np.inf), largest, np.nan)
    x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    rows = (
        (xx - yy - zz + ww, 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), yy - xx - zz + ww, 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), zz - xx - yy + ww),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def interpolate(before: Array, after: Array, fraction: Array) -> Array:
    """Poses (N, 4, 4) at fractions (N,) between two: straight line, constant angular velocity."""
    T = before.copy()
    turn = rotation_vector(np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3])
    part = np.asarray(fraction)[:, None]
    T[:, :3, :3] = before[:, :3, :3] @ rotation_from_vector(part * turn)
    T[:, :3, 3] = (1 - part) * before[:, :3, 3] + part * after[:, :3, 3]
    return T


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
    return rigid_transform(R, target - (R @ center[..., None])[..., 0])


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
    """The rotations (..., 3, 3) nearest to any matrices (..., 3, 3), by their SVD."""
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return np.asarray(U @ Vt)


def is_backward(T: Array) -> bool:
    """Tell whether the second camera stands to the left of the first. T: (4, 4) from the axes of
    the first to those of the second.
    """
    x, y, _ = inverse(T)[:3, 3]
    return bool(x < -abs(y))
