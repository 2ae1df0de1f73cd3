"""Normal equations of bundle adjustment: points are eliminated, and the equations of the frames are
kept.

An observation is compared with its point in image space, x / z, y / z, 1 / z. Poses move by a turn
(rad) and then a shift (m) in their own axes. Observations are sorted by point; ``start`` (m + 1,)
says where each point's begin. Functions work on a range of points, of observations or of frames, so
that several cores share them; none writes where another range does.
"""

from typing import Any

import numpy as np

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.track.relative_pose import invert_symmetric

# Compiled functions for one observation of bundle adjustment: its residual, its derivatives, and
# its part of the normal equations.
#
# An observation is compared with its point in image space, x / z, y / z, 1 / z. Poses move by a
# turn
# (rad) and then a shift (m) in their own axes.

BEHIND = 1e6
"""Squared standard errors of a point behind the camera: it pulls nowhere, and no step that puts one
there looks better.
"""


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
    T: Any,
    point: Any,
    seen: Any,
    weight: Any,
    outlier_sigmas: float,
    residual: Any,
    by_pose: Any,
    by_point: Any,
) -> float:
    """Write the residual and the derivatives of the prediction, in standard errors; return the
    weight of the Cauchy kernel.
    """
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
    """Add an observation to the equations of its point: V (3, 3), own_g (3,)."""
    for i in range(3):
        own_g[i] += robust * (
            by_point[0, i] * residual[0]
            + by_point[1, i] * residual[1]
            + by_point[2, i] * residual[2]
        )
        for j in range(3):
            across = (
                by_point[0, i] * by_point[0, j]
                + by_point[1, i] * by_point[1, j]
                + by_point[2, i] * by_point[2, j]
            )
            V[i, j] += robust * across


@compiled
def add_pose(robust: float, residual: Any, by_pose: Any, damping: float, H: Any, g: Any) -> None:
    """Add an observation to the equations of its pose: H (6, 6), g (6,)."""
    for i in range(6):
        g[i] += robust * (
            by_pose[0, i] * residual[0] + by_pose[1, i] * residual[1] + by_pose[2, i] * residual[2]
        )
        for j in range(6):
            by = robust * (1 + damping) if i == j else robust
            H[i, j] += by * (
                by_pose[0, i] * by_pose[0, j]
                + by_pose[1, i] * by_pose[1, j]
                + by_pose[2, i] * by_pose[2, j]
            )


@compiled
def robust_cost(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    frame: Any,  # (n,) int64
    point: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64, inverse standard errors
    outlier_sigmas: float,  # scale of the Cauchy kernel
    first: int,
    end: int,
) -> float:
    """Compute half of the robust sum of squares of the observations from ``first`` to ``end``
    - 1.
    """
    residual, cost = np.empty(3), 0.0
    for k in range(first, end):
        squared = residual_of(T[frame[k]], points[point[k]], seen[k], weight[k], residual)
        cost += 0.5 * outlier_sigmas**2 * np.log1p(squared / outlier_sigmas**2)
    return cost


@compiled
def point_blocks(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64
    outlier_sigmas: float,
    damping: float,  # the diagonal's factor, less 1
    stays: Any,  # (m,) bool, points that are not eliminated
    W: Any,  # (n, 3, 6) float64, written: each observation's block of point and pose
    # (m, 3, 3) float64, written: inverses of the points' own blocks; of points that stay the blocks
    # themselves
    V: Any,
    own_g: Any,  # (m, 3) float64, written: their right sides
    first: int,
    end: int,
) -> None:
    """Write the equations of the points from ``first`` to ``end`` - 1."""
    residual, by_pose = np.empty(3), np.empty((3, 6))
    by_point, block = np.empty((3, 3)), np.empty((3, 3))
    for p in range(first, end):
        block[:] = 0
        own_g[p] = 0
        for k in range(start[p], start[p + 1]):
            robust = linearized(
                T[frame[k]],
                points[p],
                seen[k],
                weight[k],
                outlier_sigmas,
                residual,
                by_pose,
                by_point,
            )
            add_point(robust, residual, by_point, block, own_g[p])
            for i in range(3):
                for j in range(6):
                    across = (
                        by_point[0, i] * by_pose[0, j]
                        + by_point[1, i] * by_pose[1, j]
                        + by_point[2, i] * by_pose[2, j]
                    )
                    W[k, i, j] = robust * across
        for i in range(3):
            block[i, i] *= 1 + damping
        if stays[p]:
            for i in range(3):
                for j in range(3):
                    V[p, i, j] = block[i, j]
        else:
            invert_symmetric(block, V[p])


@compiled
def frame_rows(
    T: Any,  # (N, 4, 4) float64, world to camera
    points: Any,  # (m, 3) float64
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    point: Any,  # (n,) int64
    seen: Any,  # (n, 3) float64
    weight: Any,  # (n, 3) float64
    outlier_sigmas: float,
    damping: float,
    stays: Any,  # (m,) bool
    W: Any,  # (n, 3, 6) float64, as ``point_blocks`` wrote them
    V: Any,  # (m, 3, 3) float64
    own_g: Any,  # (m, 3) float64
    place: Any,  # (N,) int64, the block of a frame
    order: Any,  # (n,) int64, observations by the block of their frame
    row_start: Any,  # (blocks + 1,) int64, where each block's begin in ``order``
    size: int,  # blocks of 6 in a part of the system
    diagonal: Any,  # (K, 6 size, 6 size) float64, added to: parts on the diagonal, lower triangle
    below: Any,  # (K - 1, 6 size, 6 size) float64, added to: parts below those
    g: Any,  # (6 blocks,) float64, added to
    first: int,
    end: int,
) -> None:
    """Add the equations of the blocks from ``first`` to ``end`` - 1, less the Schur complement of
    their points.

    Each block is summed up by itself, in the order of its observations: how the blocks are shared
    out shows in no result.
    """
    residual, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    Y, H, right = np.empty((6, 3)), np.empty((6, 6)), np.empty(6)
    for row in range(first, end):
        part, i0 = row // size, 6 * (row % size)
        H[:] = 0
        right[:] = 0
        for n in range(row_start[row], row_start[row + 1]):
            k = order[n]
            p = point[k]
            robust = linearized(
                T[frame[k]],
                points[p],
                seen[k],
                weight[k],
                outlier_sigmas,
                residual,
                by_pose,
                by_point,
            )
            add_pose(robust, residual, by_pose, damping, H, right)
            if stays[p]:
                continue
            _by_point(W[k], V[p], Y)
            for i in range(6):
                right[i] -= Y[i, 0] * own_g[p, 0] + Y[i, 1] * own_g[p, 1] + Y[i, 2] * own_g[p, 2]
            for other in range(start[p], start[p + 1]):
                column = place[frame[other]]
                if column <= row:
                    target = diagonal[part] if column >= part * size else below[part - 1]
                    _subtract(target, i0, 6 * (column % size), Y, W[other])
        for i in range(6):
            g[6 * row + i] += right[i]
            for j in range(6):
                diagonal[part, i0 + i, i0 + j] += H[i, j]


@compiled
def keep_points(
    kept: Any,  # (k,) int64, points that stay
    own_place: Any,  # (k,) int64, their blocks
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    W: Any,  # (n, 3, 6) float64
    V: Any,  # (m, 3, 3) float64
    own_g: Any,  # (m, 3) float64
    place: Any,  # (N,) int64
    size: int,
    diagonal: Any,  # (K, 6 size, 6 size) float64, added to
    below: Any,  # (K - 1, 6 size, 6 size) float64, added to
    g: Any,  # (6 blocks,) float64, added to
) -> None:
    """Add the equations of points that stay: the first three numbers of their blocks."""
    for q in range(len(kept)):
        p, own = kept[q], own_place[q]
        part, i0 = own // size, 6 * (own % size)
        for i in range(3):
            g[6 * own + i] += own_g[p, i]
            for j in range(3):
                diagonal[part, i0 + i, i0 + j] += V[p, i, j]
        for k in range(start[p], start[p + 1]):
            row = place[frame[k]]
            part, other = min(row, own) // size, 6 * (row % size)
            target = diagonal[part] if row // size == own // size else below[part]
            for i in range(3):
                for j in range(6):
                    if row > own:
                        target[other + j, i0 + i] += W[k, i, j]
                    else:
                        target[i0 + i, other + j] += W[k, i, j]


@compiled
def point_steps(
    start: Any,  # (m + 1,) int64
    frame: Any,  # (n,) int64
    W: Any,  # (n, 3, 6) float64, as ``point_blocks`` wrote them
    V: Any,  # (m, 3, 3) float64
    own_g: Any,  # (m, 3) float64
    moves: Any,  # (N, 6) float64, of the frames
    steps: Any,  # (m, 3) float64, written
    first: int,
    end: int,
) -> None:
    """Write how eliminated points from ``first`` to ``end`` - 1 move when the frames do."""
    left = np.empty(3)
    for p in range(first, end):
        for i in range(3):
            left[i] = own_g[p, i]
        for k in range(start[p], start[p + 1]):
            for i in range(3):
                for j in range(6):
                    left[i] -= W[k, i, j] * moves[frame[k], j]
        for i in range(3):
            steps[p, i] = V[p, i, 0] * left[0] + V[p, i, 1] * left[1] + V[p, i, 2] * left[2]


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
    first: int,
    end: int,
) -> None:
    """Write residuals of the points from ``first`` to ``end`` - 1 in standard errors, corrected for
    their leverage on the points.

    So they are as large as if the points' positions had not been fitted to them.
    """
    residual, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    V, inverse, own_g = np.empty((3, 3)), np.empty((3, 3)), np.zeros(3)
    for p in range(first, end):
        V[:] = 0
        for k in range(start[p], start[p + 1]):
            linearized(
                T[frame[k]], points[p], seen[k], weight[k], np.inf, residual, by_pose, by_point
            )
            add_point(1.0, residual, by_point, V, own_g)
        invert_symmetric(V, inverse)
        for k in range(start[p], start[p + 1]):
            linearized(
                T[frame[k]], points[p], seen[k], weight[k], np.inf, residual, by_pose, by_point
            )
            for r in range(3):
                taken = 0.0
                for i in range(3):
                    along = (
                        inverse[i, 0] * by_point[r, 0]
                        + inverse[i, 1] * by_point[r, 1]
                        + inverse[i, 2] * by_point[r, 2]
                    )
                    taken += by_point[r, i] * along
                errors[k, r] = residual[r] / np.sqrt(max(1 - taken, least_left))


@compiled
def _by_point(W: Any, inverse: Any, Y: Any) -> None:
    """Write Y (6, 3): an observation's block (3, 6) by the inverse (3, 3) of its point's."""
    for i in range(6):
        for j in range(3):
            Y[i, j] = W[0, i] * inverse[0, j] + W[1, i] * inverse[1, j] + W[2, i] * inverse[2, j]


@compiled
def _subtract(H: Any, row: int, column: int, Y: Any, W: Any) -> None:
    """Take Y (6, 3) times W (3, 6) off a block (6, 6) of H."""
    for i in range(6):
        for j in range(6):
            H[row + i, column + j] -= Y[i, 0] * W[0, j] + Y[i, 1] * W[1, j] + Y[i, 2] * W[2, j]
