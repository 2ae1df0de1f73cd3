"""Normal equations of bundle adjustment: points are eliminated as they are linearized, and those of the frames are kept.

A sighting is held against its point in image space, x / z, y / z, 1 / z. Poses move by a turn (rad) and then a shift (m) in their
own axes. Sightings are sorted by point; ``start`` (m + 1,) says where each point's begin.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.track.small_matrices import invert_symmetric

BEHIND = 1e6
"""Squared standard errors of a point behind the camera: it pulls nowhere, and no step that puts one there looks better."""


@compiled
def robust_cost(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    frame: Any,  # (n,) int64
    point: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64, inverse standard errors
    outlier_sigmas: float,  # scale of the Cauchy kernel
) -> float:
    """Half of the robust sum of squares."""
    residual, cost = np.empty(3), 0.0
    for k in range(len(frame)):
        squared = _residual(T[frame[k]], points[point[k]], seen[k], weight[k], residual)
        cost += 0.5 * outlier_sigmas**2 * np.log1p(squared / outlier_sigmas**2)
    return cost


@compiled
def normal_equations(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64
    place: Any,  # (N,) int64, the block of a frame
    own_place: Any,  # (m,) int64, the block of a point that is not eliminated, -1 for others
    outlier_sigmas: float,
    damping: float,  # the diagonal's factor, less 1
    size: int,  # blocks of 6 in a part of the system
    diagonal: Any,  # (K, 6 size, 6 size) float64, added to: parts on the diagonal, lower triangle
    below: Any,  # (K - 1, 6 size, 6 size) float64, added to: parts below those
    g: Any,  # (6 blocks,) float64, added to
    inverse: Any,  # (m, 3, 3) float64, written: inverses of the points' own blocks
    own_g: Any,  # (m, 3) float64, written
) -> None:
    """Of the frames, once points are eliminated (Schur complement); those with a block of their own stay."""
    most = np.diff(start).max()
    residual, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    W, Y, V, H = np.empty((most, 6, 3)), np.empty((6, 3)), np.empty((3, 3)), np.empty((6, 6))
    for p in range(len(points)):
        V[:] = 0
        own_g[p] = 0
        first, views = start[p], start[p + 1] - start[p]
        for s in range(views):
            k = first + s
            robust = _linearized(T[frame[k]], points[p], seen[k], weight[k], outlier_sigmas, residual, by_pose, by_point)
            row = place[frame[k]]
            _products(robust, residual, by_pose, by_point, H, W[s], V, g[6 * row : 6 * row + 6], own_g[p])
            for i in range(6):
                H[i, i] *= 1 + damping
            _add(diagonal, below, size, row, row, H)
        for i in range(3):
            V[i, i] *= 1 + damping
        rows = place[frame[first : first + views]]
        if own_place[p] >= 0:
            _keep(diagonal, below, g, size, rows, own_place[p], W, V, own_g[p])
        else:
            invert_symmetric(V, inverse[p])
            _eliminate(diagonal, below, g, size, rows, W, inverse[p], own_g[p], Y, H)


@compiled
def _products(robust: float, residual: Any, by_pose: Any, by_point: Any, H: Any, W: Any, V: Any, g: Any, own_g: Any) -> None:
    """Of a sighting: write H (6, 6) of its pose and W (6, 3) of pose and point; add to V (3, 3) of the point, g, own_g."""
    for i in range(6):
        g[i] += robust * (by_pose[0, i] * residual[0] + by_pose[1, i] * residual[1] + by_pose[2, i] * residual[2])
        for j in range(6):
            H[i, j] = robust * (by_pose[0, i] * by_pose[0, j] + by_pose[1, i] * by_pose[1, j] + by_pose[2, i] * by_pose[2, j])
        for j in range(3):
            W[i, j] = robust * (by_pose[0, i] * by_point[0, j] + by_pose[1, i] * by_point[1, j] + by_pose[2, i] * by_point[2, j])
    for i in range(3):
        own_g[i] += robust * (by_point[0, i] * residual[0] + by_point[1, i] * residual[1] + by_point[2, i] * residual[2])
        for j in range(3):
            V[i, j] += robust * (
                by_point[0, i] * by_point[0, j] + by_point[1, i] * by_point[1, j] + by_point[2, i] * by_point[2, j]
            )


@compiled
def _eliminate(diagonal: Any, below: Any, g: Any, size: int, rows: Any, W: Any, inverse: Any, own_g: Any, Y: Any, H: Any) -> None:
    """Take a point out of the equations of the frames at rows; Y (6, 3) and H (6, 6) are overwritten."""
    for s in range(len(rows)):
        for i in range(6):
            for j in range(3):
                Y[i, j] = W[s, i, 0] * inverse[0, j] + W[s, i, 1] * inverse[1, j] + W[s, i, 2] * inverse[2, j]
            g[6 * rows[s] + i] -= Y[i, 0] * own_g[0] + Y[i, 1] * own_g[1] + Y[i, 2] * own_g[2]
        for t in range(len(rows)):
            if rows[t] <= rows[s]:
                for i in range(6):
                    for j in range(6):
                        H[i, j] = -(Y[i, 0] * W[t, j, 0] + Y[i, 1] * W[t, j, 1] + Y[i, 2] * W[t, j, 2])
                _add(diagonal, below, size, rows[s], rows[t], H)


@compiled
def point_steps(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64
    outlier_sigmas: float,
    moves: Any,  # (N, 6) float64, of the frames
    inverse: Any,  # (m, 3, 3) float64, as ``normal_equations`` wrote them
    own_g: Any,  # (m, 3) float64
    steps: Any,  # (m, 3) float64, written
) -> None:
    """How eliminated points move when the frames do."""
    residual, by_pose, by_point, left = np.empty(3), np.empty((3, 6)), np.empty((3, 3)), np.empty(3)
    for p in range(len(points)):
        left[:] = own_g[p]
        for k in range(start[p], start[p + 1]):
            robust = _linearized(T[frame[k]], points[p], seen[k], weight[k], outlier_sigmas, residual, by_pose, by_point)
            for r in range(3):
                moved = 0.0
                for j in range(6):
                    moved += by_pose[r, j] * moves[frame[k], j]
                for i in range(3):
                    left[i] -= robust * by_point[r, i] * moved
        for i in range(3):
            steps[p, i] = inverse[p, i, 0] * left[0] + inverse[p, i, 1] * left[1] + inverse[p, i, 2] * left[2]


@compiled
def own_errors(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64
    least_left: float,  # of a residual's variance
    errors: Any,  # (n, 3) float64, written
) -> None:
    """Residuals in standard errors, as large as if the points' places had not been fitted to them: less their leverage."""
    residual, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    H, W, V, inverse, g, own_g = np.empty((6, 6)), np.empty((6, 3)), np.empty((3, 3)), np.empty((3, 3)), np.zeros(6), np.zeros(3)
    for p in range(len(points)):
        V[:] = 0
        for k in range(start[p], start[p + 1]):
            _linearized(T[frame[k]], points[p], seen[k], weight[k], np.inf, residual, by_pose, by_point)
            _products(1.0, residual, by_pose, by_point, H, W, V, g, own_g)
        invert_symmetric(V, inverse)
        for k in range(start[p], start[p + 1]):
            _linearized(T[frame[k]], points[p], seen[k], weight[k], np.inf, residual, by_pose, by_point)
            for r in range(3):
                taken = 0.0
                for i in range(3):
                    along = inverse[i, 0] * by_point[r, 0] + inverse[i, 1] * by_point[r, 1] + inverse[i, 2] * by_point[r, 2]
                    taken += by_point[r, i] * along
                errors[k, r] = residual[r] / np.sqrt(max(1 - taken, least_left))


@compiled
def _residual(T: Any, point: Any, seen: Any, weight: Any, residual: Any) -> float:
    """Write it, in standard errors; its square."""
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
def _linearized(
    T: Any, point: Any, seen: Any, weight: Any, outlier_sigmas: float, residual: Any, by_pose: Any, by_point: Any
) -> float:
    """Write the residual and the derivatives of what is predicted, in standard errors; the weight of the Cauchy kernel."""
    squared = _residual(T, point, seen, weight, residual)
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
def _keep(diagonal: Any, below: Any, g: Any, size: int, rows: Any, own: int, W: Any, V: Any, own_g: Any) -> None:
    """Add the equations of a point that stays: the first three numbers of its block."""
    H = np.zeros((6, 6))
    H[:3, :3] = V
    _add(diagonal, below, size, own, own, H)
    g[6 * own : 6 * own + 3] += own_g
    for s in range(len(rows)):
        H[:] = 0
        row = rows[s]
        if row > own:
            H[:, :3] = W[s]
            _add(diagonal, below, size, row, own, H)
        else:
            H[:3] = W[s].T
            _add(diagonal, below, size, own, row, H)


@compiled
def _add(diagonal: Any, below: Any, size: int, row: int, column: int, H: Any) -> None:
    """Add a block (6, 6) of the lower triangle: row >= column."""
    part = diagonal[row // size] if row // size == column // size else below[column // size]
    i0, j0 = 6 * (row % size), 6 * (column % size)
    for i in range(6):
        for j in range(6):
            part[i0 + i, j0 + j] += H[i, j]
