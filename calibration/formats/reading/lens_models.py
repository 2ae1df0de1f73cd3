"""Lens models that OpenCV does not have: approximated by the nearest pinhole or fisheye model where
that is near enough.

Each model here takes directions (n, 3), z forward, to the plane (n, 2) that the camera matrix maps
to pixels. Sources: Mei and Rives 2007 (omni), Usenko et al. 2018, *The Double Sphere Camera Model*
(ds, eucm), Devernay and Faugeras 2001 (fov), the appendix of the *Agisoft Metashape User Manual*
(frame, fisheye).
"""

from collections.abc import Callable

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.cameras import make_camera
from calibration.geometry import Array
from calibration.rig import Camera, CameraModel

Plane = Callable[[Array], Array]
Size = tuple[int, int]
# of a model that stands for a lens, anywhere in the image: a fifth of what calibrations leave
MAX_ERROR_PX = 0.1
WIDEST_DEG = 110.0  # from the axis: beyond the corners of all lenses that are used for stereo
PINHOLE_DEG = 80.0  # a plane image reaches no farther
STEPS = (111, 24)  # from the axis, and around it


def omni(xi: float, distortion: Array) -> Plane:
    """The unified model, with k1 k2 p1 p2 behind it."""

    def plane(d: Array) -> Array:
        m = d[:, :2] / (d[:, 2:] + xi * _length(d))
        return m + brown_terms(m)[..., [0, 1, 3, 4]] @ distortion

    return plane


def double_sphere(xi: float, alpha: float) -> Plane:
    """Two unit spheres, their centers xi apart."""

    def plane(d: Array) -> Array:
        z = d[:, 2:] + xi * _length(d)
        return np.asarray(d[:, :2] / (alpha * np.hypot(_across(d), z) + (1 - alpha) * z))

    return plane


def extended_unified(alpha: float, beta: float) -> Plane:
    """eucm; with beta = 1 the unified model."""

    def plane(d: Array) -> Array:
        return np.asarray(
            d[:, :2]
            / (alpha * np.sqrt(beta * _across(d) ** 2 + d[:, 2:] ** 2) + (1 - alpha) * d[:, 2:])
        )

    return plane


def field_of_view(omega: float) -> Plane:
    """Radii as the arc of their angle."""

    def plane(d: Array) -> Array:
        m = d[:, :2] / d[:, 2:]
        radius = np.maximum(_across(m), 1e-12)
        return np.asarray(m * np.arctan(2 * radius * np.tan(omega / 2)) / (omega * radius))

    return plane


def metashape(radial: Array, tangential: Array, fisheye: bool) -> Plane:
    """k1 to k4, and p1 and p2, which are OpenCV's p2 and p1; radii of a fisheye are angles."""

    def plane(d: Array) -> Array:
        across = np.maximum(_across(d), 1e-12)
        m = d[:, :2] / across * np.arctan2(across, d[:, 2:]) if fisheye else d[:, :2] / d[:, 2:]
        bent = brown_terms(m) @ np.concatenate([radial[:3], tangential[::-1]])
        return np.asarray(m + bent + radial[3] * m * _across(m) ** 8)

    return plane


def fitted_camera(where: str, plane: Plane, K: Array, size: Size, name: str) -> Camera:
    """The camera that sees as ``plane`` and ``K`` say. Raises CalibrationError if none is near."""
    d, angle = _directions()
    with np.errstate(all="ignore"):
        m = plane(d)
        pixels = m @ K[:2, :2].T + K[:2, 2]
        seen = np.isfinite(m).all(axis=1) & ((pixels >= 0) & (pixels <= np.array(size) - 1)).all(
            axis=1
        )
        seen &= (m * d[:, :2]).sum(axis=1) > 0
    fits: list[tuple[float, CameraModel, Array]] = []
    for model, widest in (("pinhole", PINHOLE_DEG), ("fisheye", WIDEST_DEG)):
        if seen.sum() > STEPS[1] and np.degrees(angle[seen]).max() <= widest:
            fits.append(_fit(d[seen], m[seen], model, K))  # type: ignore[arg-type]
    error_px, model, terms = min(
        fits, key=lambda fit: fit[0], default=(np.inf, "pinhole", np.zeros(0))
    )
    if error_px > MAX_ERROR_PX:
        raise CalibrationError(
            f"{where}: no supported lens model agrees with this {name} better than "
            f"{error_px:.2f} px: calibrate with pinhole or equidistant"
        )
    focal = np.diag([terms[0], terms[0], 1.0])
    return make_camera(where, K @ focal, terms[1:] / terms[0], size, model)


def _directions() -> tuple[Array, Array]:
    """Unit vectors (n, 3) over more than half a sphere, and their angles (n,) from the axis."""
    steps, turns = STEPS
    angle = np.repeat(np.radians(np.linspace(0.5, WIDEST_DEG, steps)), turns)
    around = np.tile(np.linspace(0, 2 * np.pi, turns, endpoint=False), steps)
    return np.column_stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
    ), angle


def _fit(d: Array, m: Array, model: CameraModel, K: Array) -> tuple[float, CameraModel, Array]:
    """Largest error in pixels, the model, and the focal length by which K's is multiplied, before
    it times the coefficients.

    Linear, since both models are sums of terms.
    """
    if model == "fisheye":
        across = _across(d)
        angle = np.arctan2(across, d[:, 2:])
        terms = np.stack([d[:, :2] / across * angle ** (2 * n + 1) for n in range(5)], axis=-1)
    else:
        flat = d[:, :2] / d[:, 2:]
        terms = np.concatenate([flat[..., None], brown_terms(flat)[..., [0, 1, 3, 4, 2]]], axis=-1)
    found, *_ = np.linalg.lstsq(terms.reshape(-1, terms.shape[-1]), m.ravel(), rcond=None)
    error = np.abs((terms @ found - m) * K[[0, 1], [0, 1]]).max()
    return float(error), model, found


def brown_terms(m: Array) -> Array:
    """(n, 2, 5) what k1 k2 k3 p1 p2, as OpenCV counts them, add to x and to y."""
    x, y = m.T
    r2 = x**2 + y**2
    radial = m[..., None] * np.stack([r2, r2**2, r2**3], axis=-1)[:, None]
    tangential = np.stack(
        [np.stack([2 * x * y, r2 + 2 * x**2], -1), np.stack([r2 + 2 * y**2, 2 * x * y], -1)], axis=1
    )
    return np.concatenate([radial, tangential], axis=-1)


def _length(d: Array) -> Array:
    return np.asarray(np.linalg.norm(d, axis=1, keepdims=True))


def _across(d: Array) -> Array:
    return np.asarray(np.linalg.norm(d[:, :2], axis=1, keepdims=True))
