"""Rigid transforms: invert, interpolate, level."""

import numpy as np
from numpy.typing import NDArray

Poses = NDArray[np.float64]
"""(N, 4, 4) float64 rigid transforms."""


def inverse(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of rigid transforms, (..., 4, 4)."""
    result = np.zeros_like(T)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = R
    result[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1
    return result


def rotation_vector(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) axis times angle of a rotation (3, 3)."""
    cosine = np.clip((np.trace(R) - 1) / 2, -1, 1)
    angle = float(np.arccos(cosine))
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    if angle < 1e-8:
        return np.asarray(axis / 2)
    if np.pi - angle < 1e-6:  # the antisymmetric part vanishes: take the axis from R + I = 2 a a^T
        column = (R + np.eye(3))[:, np.argmax(np.diag(R))]
        return np.asarray(angle * column / np.linalg.norm(column))
    return np.asarray(axis * angle / (2 * np.sin(angle)))


def rotation_from_vector(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-300)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def interpolate(before: NDArray[np.float64], after: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The pose at ``share`` of the way: straight line, constant turn."""
    T = before.copy()
    turn = rotation_vector(before[:3, :3].T @ after[:3, :3])
    T[:3, :3] = before[:3, :3] @ rotation_from_vector(share * turn)
    T[:3, 3] = (1 - share) * before[:3, 3] + share * after[:3, 3]
    return T


def rotation_to_z(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest rotation (3, 3) that turns ``direction`` onto +z."""
    unit = direction / np.linalg.norm(direction)
    axis = np.cross(unit, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(unit[2])
    if sine < 1e-12:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_from_vector(axis / sine * np.arctan2(sine, cosine))
