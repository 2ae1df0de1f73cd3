"""Bundle adjustment of one or two cameras over many views of a target: all parameters at once.

Levenberg-Marquardt on the reprojection error; each view's pose is eliminated by the Schur
complement (Triggs et al. 2000, Bundle Adjustment: A Modern Synthesis, sec. 6.1). Pinhole and
fisheye, one camera and two, whole boards and parts of them go the same way here; OpenCV's fisheye
calibration takes no board seen in part, and gives up where the lens is far from its first guess.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import camera_matrix
from calibration.rig import CameraModel
from calibration.transforms import transform_points

Array = NDArray[np.float64]
MAX_ITERATIONS = 100  # a bound: fits end before, by CONVERGED
CONVERGED = 1e-7  # gain of a step, of the squared error


@dataclass(frozen=True, eq=False)
class CornerObservation:
    """Corners of a view in one camera. side: 0 left, 1 right; points_m: (n, 3); pixels: (n, 2)."""

    view: int
    side: int
    points_m: Array
    pixels: Array


@dataclass(frozen=True)
class Lens:
    """A family of lens models. square_pixels: fx = fy, as sensors are made; False where a tilted
    port or a lens stretches them.
    """

    model: CameraModel
    coefficients: int
    square_pixels: bool = True

    @property
    def name(self) -> str:
        """Such as "pinhole, 5 coefficients"."""
        return (
            f"{self.model}, {self.coefficients} "
            f"coefficients{'' if self.square_pixels else ', fx and fy apart'}"
        )


@dataclass(frozen=True, eq=False)
class Bundle:
    """The parameters that are solved for.

    intrinsics: fx fy cx cy and distortion of the left and the right camera; T_right_left: (4, 4);
    T_left_target: (views, 4, 4).
    """

    lens: Lens
    intrinsics: tuple[Array, Array]
    T_right_left: Array
    T_left_target: Array


def project(points: Array, intrinsics: Array, model: CameraModel) -> tuple[Array, Array, Array]:
    """Pixels (n, 2) of points (n, 3) in camera axes; derivatives by the point (n, 2, 3) and by the
    intrinsics (n, 2, k).
    """
    K, distortion, zero = camera_matrix(*intrinsics[:4]), intrinsics[4:], np.zeros(3)
    shaped = points.reshape(-1, 1, 3)
    if model == "fisheye":
        pixels, jacobian = cv2.fisheye.projectPoints(shaped, zero, zero, K, distortion)
        by_point, by_intrinsics = jacobian[:, 11:14], jacobian[:, :8]
    else:
        pixels, jacobian = cv2.projectPoints(shaped, zero, zero, K, distortion)
        by_point, by_intrinsics = jacobian[:, 3:6], jacobian[:, 6 : 6 + intrinsics.size]
    n = len(points)
    return pixels.reshape(n, 2), by_point.reshape(n, 2, 3), by_intrinsics.reshape(n, 2, -1)


@dataclass(frozen=True, eq=False)
class _SideCorners:
    """All corners of one side, so that OpenCV projects them in one call. views: each of its views
    with its slice of the corners. points_m: (n, 3) on the target; pixels: (n, 2).
    """

    side: int
    views: tuple[tuple[int, slice], ...]
    points_m: Array
    pixels: Array

    def in_left(self, bundle: Bundle) -> Array:
        """(n, 3) corners in the axes of the left camera."""
        return np.concatenate(
            [
                transform_points(bundle.T_left_target[view], self.points_m[part])
                for view, part in self.views
            ]
        )

    def residuals(self, bundle: Bundle) -> Array:
        """Projected minus measured corners: (n, 2) pixels."""
        points = self.in_left(bundle)
        if self.side == 1:
            points = transform_points(bundle.T_right_left, points)
        projected = project(points, bundle.intrinsics[self.side], bundle.lens.model)[0]
        return projected - self.pixels


def _by_side(observations: Sequence[CornerObservation]) -> list[_SideCorners]:
    """The observations joined by side."""
    sides = []
    for side in sorted({observation.side for observation in observations}):
        own = [observation for observation in observations if observation.side == side]
        ends = np.cumsum([0, *(len(observation.pixels) for observation in own)]).tolist()
        views = tuple(
            (one.view, slice(*ends_of)) for one, ends_of in zip(own, pairwise(ends), strict=True)
        )
        points_m, pixels = (
            np.concatenate([getattr(one, name) for one in own]) for name in ("points_m", "pixels")
        )
        sides.append(_SideCorners(side, views, points_m, pixels))
    return sides


def residuals(bundle: Bundle, observations: Sequence[CornerObservation]) -> Array:
    """Projected minus measured corners, those of the left side first: (n, 2) pixels."""
    return np.concatenate([side.residuals(bundle) for side in _by_side(observations)])


def rms(bundle: Bundle, observations: Sequence[CornerObservation]) -> float:
    """Root mean square distance in pixels between corners and their projections."""
    off = residuals(bundle, observations)
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def solve(
    start: Bundle,
    observations: Sequence[CornerObservation],
    poses_only: bool = False,
    iterations: int = MAX_ITERATIONS,
) -> Bundle:
    """The bundle of least reprojection error near ``start``. poses_only: move the target alone."""
    sides = _by_side(observations)
    bundle, error = start, _cost(start, sides)
    damping = 1e-3
    for _ in range(iterations):
        equations = _normal_equations(bundle, sides)
        improved = False
        while not improved and damping < 1e12:
            try:
                candidate = moved(bundle, *_step(equations, damping, poses_only))
            except np.linalg.LinAlgError:  # a pose that its corners do not determine
                damping *= 10.0
                continue
            moved_error = _cost(candidate, sides)
            improved = moved_error < error
            damping *= 0.1 if improved else 10.0
        if not improved:
            break
        gain = (error - moved_error) / error
        bundle, error = candidate, moved_error
        if gain < CONVERGED:
            break
    return bundle


@dataclass(frozen=True, eq=False)
class _Equations:
    """Blocks of J^T J and J^T r: shared U (g, g), views V (v, 6, 6), coupling W (v, g, 6)."""

    U: Array
    V: Array
    W: Array
    r_shared: Array
    r_views: Array


def _normal_equations(bundle: Bundle, sides: Sequence[_SideCorners]) -> _Equations:
    sizes = [intrinsics.size for intrinsics in bundle.intrinsics]
    shared, views = sum(sizes) + 6, len(bundle.T_left_target)
    U, V, W = np.zeros((shared, shared)), np.zeros((views, 6, 6)), np.zeros((views, shared, 6))
    r_shared, r_views = np.zeros(shared), np.zeros((views, 6))
    for side in sides:
        residual, J_shared, J_view = _linearize(bundle, side, sizes)
        U += _product(J_shared, J_shared)
        r_shared += _product(J_shared, residual)
        for view, part in side.views:
            V[view] += _product(J_view[part], J_view[part])
            W[view] += _product(J_shared[part], J_view[part])
            r_views[view] += _product(J_view[part], residual[part])
    return _Equations(U, V, W, r_shared, r_views)


def equations_by_view(
    bundle: Bundle, observations: Sequence[CornerObservation]
) -> tuple[Array, Array]:
    """J^T J (v, g, g) and J^T r (v, g) of what all views share, view by view, its pose
    eliminated.
    """
    found = []
    for view in range(len(bundle.T_left_target)):
        own = [replace(one, view=0) for one in observations if one.view == view]
        alone = replace(bundle, T_left_target=bundle.T_left_target[view : view + 1])
        one = _normal_equations(alone, _by_side(own))
        WV = one.W[0] @ np.linalg.inv(one.V[0])
        found.append((one.U - WV @ one.W[0].T, one.r_shared - WV @ one.r_views[0]))
    J2, Jr = zip(*found, strict=True)
    return np.array(J2), np.array(Jr)


def _product(a: Array, b: Array) -> Array:
    """a^T b over the corners and the two coordinates of a pixel, their first two axes."""
    return a.reshape(-1, *a.shape[2:]).T @ b.reshape(-1, *b.shape[2:])


def _linearize(bundle: Bundle, side: _SideCorners, sizes: list[int]) -> tuple[Array, Array, Array]:
    """Residuals (n, 2) and their derivatives by shared parameters (n, 2, g) and by the pose of each
    corner's view (n, 2, 6).

    Rotations move on the left, R <- exp(w) R, so that a point p in camera axes moves by w x p.
    """
    n, T_rig = len(side.pixels), bundle.T_right_left
    points = side.in_left(bundle)
    moved = np.concatenate(
        [points[part] - bundle.T_left_target[v, :3, 3] for v, part in side.views]
    )
    by_pose, by_rig = _by_motion(moved), np.zeros((n, 3, 6))
    if side.side == 1:
        points = transform_points(T_rig, points)
        by_pose = T_rig[:3, :3] @ by_pose
        by_rig = _by_motion(points - T_rig[:3, 3])
    pixels, by_point, by_intrinsics = project(
        points, bundle.intrinsics[side.side], bundle.lens.model
    )
    J_shared = np.zeros((n, 2, sum(sizes) + 6))
    first = 0 if side.side == 0 else sizes[0]
    J_shared[:, :, first : first + sizes[side.side]] = by_intrinsics
    if bundle.lens.square_pixels:
        J_shared[:, :, first] += J_shared[:, :, first + 1]
        J_shared[:, :, first + 1] = 0
    J_shared[:, :, -6:] = by_point @ by_rig
    return pixels - side.pixels, J_shared, by_point @ by_pose


def _by_motion(rotated: Array) -> Array:
    """(n, 3, 6) derivative of R X + t by a small rotation and by t; rotated: R X, (n, 3)."""
    x, y, z = rotated.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [zero, z, -y, one, zero, zero],
        [-z, zero, x, zero, one, zero],
        [y, -x, zero, zero, zero, one],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _step(equations: _Equations, damping: float, poses_only: bool) -> tuple[Array, Array]:
    """The damped step of the shared parameters (g,) and of each view (v, 6)."""
    V_inverse = np.linalg.inv(_damped(equations.V, damping))
    if poses_only:
        return np.zeros_like(equations.r_shared), -np.einsum(
            "vij,vj->vi", V_inverse, equations.r_views
        )
    WV = equations.W @ V_inverse
    S = _damped(equations.U, damping) - np.einsum("vij,vkj->ik", WV, equations.W)
    right = -equations.r_shared + np.einsum("vij,vj->i", WV, equations.r_views)
    shared = np.linalg.lstsq(S, right, rcond=None)[0]
    rest = -equations.r_views - np.einsum("vij,i->vj", equations.W, shared)
    return shared, np.einsum("vij,vj->vi", V_inverse, rest)


def _damped(H: Array, damping: float) -> Array:
    """Marquardt's scaling; a parameter without effect gets 1, so that it stays where it is."""
    diagonal = np.diagonal(H, axis1=-2, axis2=-1)
    added = np.where(diagonal > 0, diagonal * damping, 1.0)
    return H + added[..., None] * np.eye(H.shape[-1])


def moved(bundle: Bundle, shared: Array, views: Array) -> Bundle:
    """A bundle after a step of what all views share (g,), intrinsics left, right and rig, and of
    each view (v, 6).
    """
    changed = []
    for intrinsics, first in zip(bundle.intrinsics, (0, bundle.intrinsics[0].size), strict=True):
        step = shared[first : first + intrinsics.size].copy()
        if bundle.lens.square_pixels:
            step[1] = step[0]
        changed.append(intrinsics + step)
    return replace(
        bundle,
        intrinsics=(changed[0], changed[1]),
        T_right_left=_moved(bundle.T_right_left, shared[-6:]),
        T_left_target=np.array(
            [_moved(T, step) for T, step in zip(bundle.T_left_target, views, strict=True)]
        ),
    )


def _moved(T: Array, step: Array) -> Array:
    T = T.copy()
    T[:3, :3] = cv2.Rodrigues(step[:3])[0] @ T[:3, :3]
    T[:3, 3] += step[3:]
    return T


def _cost(bundle: Bundle, sides: Sequence[_SideCorners]) -> float:
    with np.errstate(all="ignore"):
        cost = sum(float((side.residuals(bundle) ** 2).sum()) for side in sides)
    return cost if np.isfinite(cost) else np.inf
