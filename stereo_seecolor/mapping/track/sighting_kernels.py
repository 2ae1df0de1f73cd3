"""Compiled functions for one sighting of bundle adjustment: its residual, its derivatives, and its part of the normal equations.

A sighting is compared with its point in image space, x / z, y / z, 1 / z. Poses move by a turn (rad) and then a shift (m) in their
own axes.
"""

from typing import Any

from stereo_seecolor.compute.compiled import compiled

BEHIND = 1e6
"""Squared standard errors of a point behind the camera: it pulls nowhere, and no step that puts one there looks better."""


@compiled
def residual_of(T: Any, point: Any, seen: Any, weight: Any, residual: Any) -> float:
    """Write the residual in standard errors; return its square."""
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3]
    if z <= 0:
        residual[:] = 0
        return BEHIND
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    residual[0] = (seen[0] - x / z) * weight[0]
    residual[1] = (seen[1] - y / z) * weight[1]
    residual[2] = (seen[2] - 1 / z) * weight[2]
    return residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2  # type: ignore[no-any-return]


@compiled
def linearized(
    T: Any, point: Any, seen: Any, weight: Any, outlier_sigmas: float, residual: Any, by_pose: Any, by_point: Any
) -> float:
    """Write the residual and the derivatives of the prediction, in standard errors; return the weight of the Cauchy kernel."""
    squared = residual_of(T, point, seen, weight, residual)
    if squared == BEHIND:
        by_pose[:] = 0
        by_point[:] = 0
        return 0.0
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    inverse = 1 / (T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3])
    for r in range(3):
        across = (x if r == 0 else y if r == 1 else 1.0) * inverse * inverse * weight[r]
        a = inverse * weight[r] if r == 0 else 0.0  # derivatives by x, y and z in the camera
        b = inverse * weight[r] if r == 1 else 0.0
        c = -across
        z = 1 / inverse
        by_pose[r, 0], by_pose[r, 1], by_pose[r, 2] = b * z - c * y, c * x - a * z, a * y - b * x
        by_pose[r, 3], by_pose[r, 4], by_pose[r, 5] = -a, -b, -c
        for j in range(3):
            by_point[r, j] = a * T[0, j] + b * T[1, j] + c * T[2, j]
    return 1 / (1 + squared / outlier_sigmas**2)


@compiled
def add_point(robust: float, residual: Any, by_point: Any, V: Any, own_g: Any) -> None:
    """Add a sighting to the equations of its point: V (3, 3), own_g (3,)."""
    for i in range(3):
        own_g[i] += robust * (by_point[0, i] * residual[0] + by_point[1, i] * residual[1] + by_point[2, i] * residual[2])
        for j in range(3):
            across = by_point[0, i] * by_point[0, j] + by_point[1, i] * by_point[1, j] + by_point[2, i] * by_point[2, j]
            V[i, j] += robust * across


@compiled
def add_pose(robust: float, residual: Any, by_pose: Any, damping: float, H: Any, g: Any) -> None:
    """Add a sighting to the equations of its pose: H (6, 6), g (6,)."""
    for i in range(6):
        g[i] += robust * (by_pose[0, i] * residual[0] + by_pose[1, i] * residual[1] + by_pose[2, i] * residual[2])
        for j in range(6):
            by = robust * (1 + damping) if i == j else robust
            H[i, j] += by * (by_pose[0, i] * by_pose[0, j] + by_pose[1, i] * by_pose[1, j] + by_pose[2, i] * by_pose[2, j])
