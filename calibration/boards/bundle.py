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
POSE = 6  # parameters of a view: a turn and a shift


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
    """All corners of one side, so that OpenCV projects them in one call. parts: of each of its
    views the slice of the corners; view: (n,) that of each corner. points_m: (n, 3) on the target;
    pixels: (n, 2).
    """

    side: int
    parts: tuple[tuple[int, slice], ...]
    view: NDArray[np.int64]
    points_m: Array
    pixels: Array

    def turned(self, bundle: Bundle) -> Array:
        """(n, 3) corners along the axes of the left camera, from the origin of the target."""
        R = bundle.T_left_target[self.view, :3, :3]
        return np.asarray(np.einsum("nij,nj->ni", R, self.points_m))

    def in_camera(self, bundle: Bundle, turned: Array) -> Array:
        """(n, 3) ``turned`` corners in the axes of this side's camera."""
        points = turned + bundle.T_left_target[self.view, :3, 3]
        return transform_points(bundle.T_right_left, points) if self.side == 1 else points

    def residuals(self, bundle: Bundle) -> Array:
        """Projected minus measured corners: (n, 2) pixels."""
        points = self.in_camera(bundle, self.turned(bundle))
        return project(points, bundle.intrinsics[self.side], bundle.lens.model)[0] - self.pixels


def _by_side(observations: Sequence[CornerObservation]) -> list[_SideCorners]:
    """The observations joined by side."""
    sides = []
    for side in sorted({observation.side for observation in observations}):
        own = [observation for observation in observations if observation.side == side]
        count = [len(observation.pixels) for observation in own]
        ends = pairwise(np.cumsum([0, *count]).tolist())
        parts = tuple((one.view, slice(*ends_of)) for one, ends_of in zip(own, ends, strict=True))
        view = np.repeat([one.view for one in own], count)
        points_m, pixels = (
            np.concatenate([getattr(one, name) for one in own]) for name in ("points_m", "pixels")
        )
        sides.append(_SideCorners(side, parts, view, points_m, pixels))
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
    damping = 1e-6
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
    """Blocks of J^T J and J^T r by view: shared U (v, g, g), the pose V (v, 6, 6), coupling W
    (v, g, 6).
    """

    U: Array
    V: Array
    W: Array
    r_shared: Array
    r_views: Array


def _normal_equations(bundle: Bundle, sides: Sequence[_SideCorners]) -> _Equations:
    sizes = [intrinsics.size for intrinsics in bundle.intrinsics]
    columns = POSE + sum(sizes) + 6 + 1
    products = np.zeros((len(bundle.T_left_target), columns, columns))
    for side in sides:
        rows = _linearize(bundle, side, sizes)
        for view, part in side.parts:
            own = rows[part].reshape(-1, columns)
            products[view] += own.T @ own
    shared = slice(POSE, -1)
    return _Equations(
        products[:, shared, shared],
        products[:, :POSE, :POSE],
        products[:, shared, :POSE],
        products[:, shared, -1],
        products[:, :POSE, -1],
    )


def equations_by_view(
    bundle: Bundle, observations: Sequence[CornerObservation]
) -> tuple[Array, Array]:
    """J^T J (v, g, g) and J^T r (v, g) of what all views share, view by view, its pose
    eliminated.
    """
    of = _normal_equations(bundle, _by_side(observations))
    WV = of.W @ np.linalg.inv(of.V)
    reduced = of.U - WV @ of.W.swapaxes(1, 2)
    return reduced, of.r_shared - (WV @ of.r_views[..., None])[..., 0]


def _linearize(bundle: Bundle, side: _SideCorners, sizes: list[int]) -> Array:
    """(n, 2, 6 + g + 1) of each corner: derivatives by the pose of its view and by what all views
    share; the residual.

    Rotations move on the left, R <- exp(w) R, so that a point p in camera axes moves by w x p.
    """
    T_rig, turned = bundle.T_right_left, side.turned(bundle)
    points = side.in_camera(bundle, turned)
    by_pose, by_rig = _by_motion(turned), np.zeros((len(points), 3, 6))
    if side.side == 1:
        by_pose = T_rig[:3, :3] @ by_pose
        by_rig = _by_motion(points - T_rig[:3, 3])
    pixels, by_point, by_intrinsics = project(
        points, bundle.intrinsics[side.side], bundle.lens.model
    )
    rows = np.zeros((len(points), 2, POSE + sum(sizes) + 6 + 1))
    rows[..., :POSE], rows[..., -7:-1] = by_point @ by_pose, by_point @ by_rig
    first = POSE + (0 if side.side == 0 else sizes[0])
    rows[..., first : first + sizes[side.side]] = by_intrinsics
    if bundle.lens.square_pixels:
        rows[..., first] += rows[..., first + 1]
        rows[..., first + 1] = 0
    rows[..., -1] = pixels - side.pixels
    return rows


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
        return np.zeros(equations.r_shared.shape[1]), -np.einsum(
            "vij,vj->vi", V_inverse, equations.r_views
        )
    WV = equations.W @ V_inverse
    S = _damped(equations.U.sum(axis=0), damping) - np.einsum("vij,vkj->ik", WV, equations.W)
    right = -equations.r_shared.sum(axis=0) + np.einsum("vij,vj->i", WV, equations.r_views)
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
