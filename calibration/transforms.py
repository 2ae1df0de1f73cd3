"""Rigid transforms as (4, 4) matrices: p_target = T_target_source @ p_source."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rigid(R: Array, translation: Array) -> Array:
    """Make the (4, 4) transform of a rotation (3, 3) and a translation of three numbers."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = np.ravel(translation)
    return T


def rotation_of_quaternion(xyzw: Array) -> Array:
    """The rotation (3, 3) of a quaternion, w last, of any length; NaN for one of length zero."""
    x, y, z, w = xyzw / (np.linalg.norm(xyzw) or np.nan)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * (w * cross + cross @ cross))


def inverse_transform(T: Array) -> Array:
    """The inverse of a rigid transform (4, 4)."""
    return rigid(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])
