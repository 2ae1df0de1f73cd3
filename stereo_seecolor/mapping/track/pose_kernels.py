"""Compiled loops of relative-pose estimation: residuals of a relative pose on matched points, and its normal equations."""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.track.small_matrices import invert_symmetric


@compiled
def pose_residuals(
    T: Any,  # (4, 4) float64, to the camera of a from that of b
    a: Any,  # (n, 3) float64, points in image space
    a_std: Any,  # (n, 3) float64
    b: Any,  # (n, 3) float64
    b_std: Any,  # (n, 3) float64
    outlier_sigmas: float,  # scale of the Cauchy kernel
    squared: Any,  # (n,) float64, written: residuals in standard errors, squared
    H: Any,  # (6, 6) float64, added to: of a turn (rad) and then a shift (m), in the axes of b
    g: Any,  # (6,) float64, added to
) -> None:
    """Normal equations of a pose: the derivatives of ``image_space.move``, each point weighted by both its errors."""
    weight, moved = np.empty((3, 3)), np.empty(3)
    by_point, by_pose, residual, pull = np.empty((3, 3)), np.empty((3, 6)), np.empty(3), np.empty(3)
    for n in range(len(a)):
        x, y, inverse = b[n, 0], b[n, 1], b[n, 2]
        depth = T[2, 0] * x + T[2, 1] * y + T[2, 2] + inverse * T[2, 3]
        moved[0] = (T[0, 0] * x + T[0, 1] * y + T[0, 2] + inverse * T[0, 3]) / depth
        moved[1] = (T[1, 0] * x + T[1, 1] * y + T[1, 2] + inverse * T[1, 3]) / depth
        moved[2] = inverse / depth
        for i in range(3):
            residual[i] = a[n, i] - moved[i]
            for j in range(3):
                column = j if j < 2 else 3
                own = T[i, column] if i < 2 else 0.0
                by_point[i, j] = (own - moved[i] * T[2, column]) / depth
        by_point[2, 2] += 1 / depth
        _weight(by_point, a_std[n], b_std[n], weight)
        squared[n] = 0.0
        for i in range(3):
            pull[i] = weight[i, 0] * residual[0] + weight[i, 1] * residual[1] + weight[i, 2] * residual[2]
        for i in range(3):
            squared[n] += residual[i] * pull[i]
        robust = 1 / (1 + squared[n] / outlier_sigmas**2)
        _by_pose(T, x, y, inverse, moved, depth, by_pose)
        for p in range(6):
            for i in range(3):
                g[p] += robust * by_pose[i, p] * pull[i]
            for q in range(6):
                for i in range(3):
                    across = weight[i, 0] * by_pose[0, q] + weight[i, 1] * by_pose[1, q] + weight[i, 2] * by_pose[2, q]
                    H[p, q] += robust * by_pose[i, p] * across


@compiled
def _weight(by_point: Any, a_std: Any, b_std: Any, weight: Any) -> None:
    """Write the inverse (3, 3) of the covariance of the difference between a point of a and the moved one of b."""
    c = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                c[i, j] += by_point[i, k] * by_point[j, k] * b_std[k] ** 2
        c[i, i] += a_std[i] ** 2
    invert_symmetric(c, weight)


@compiled
def _by_pose(T: Any, x: float, y: float, inverse: float, moved: Any, depth: float, by_pose: Any) -> None:
    """Write the derivatives (3, 6) of a moved point by a turn and a shift."""
    for i in range(3):
        of_row = 1.0 if i < 2 else 0.0
        for k in range(3):
            # rows of -R [ray] x: R times the ray crossed with the axes
            turn, turn_depth = _turned(T, i, x, y, k), _turned(T, 2, x, y, k)
            by_pose[i, k] = (of_row * turn - moved[i] * turn_depth) / depth
            by_pose[i, 3 + k] = inverse * (of_row * T[i, k] - moved[i] * T[2, k]) / depth


@compiled
def _turned(T: Any, row: int, x: float, y: float, axis: int) -> Any:
    """Row of -R [(x, y, 1)] x, at a column."""
    if axis == 0:
        return T[row, 2] * y - T[row, 1]
    if axis == 1:
        return T[row, 0] - T[row, 2] * x
    return T[row, 1] * x - T[row, 0] * y
