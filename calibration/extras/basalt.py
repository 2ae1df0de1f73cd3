"""Basalt's calibration.json: T_imu_cam (camera to IMU) as position and quaternion.

Lenses are kb4, pinhole and pinhole-radtan8; ds, eucm and ucm become the nearest pinhole or fisheye.
"""

from collections.abc import Callable

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.lens_models import (
    Plane,
    double_sphere,
    extended_unified,
    fitted_camera,
)
from calibration.formats.reading.section import Section, naming
from calibration.geometry import Array, camera_matrix
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse, rigid_transform, rotation_from_quaternion

MODELS: dict[str, tuple[CameraModel, tuple[str, ...]]] = {
    "pinhole": ("pinhole", ()),
    "pinhole-radtan8": ("pinhole", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "kb4": ("fisheye", ("k1", "k2", "k3", "k4")),
}
OTHERS: dict[str, tuple[tuple[str, ...], Callable[..., Plane]]] = {
    "ds": (("xi", "alpha"), double_sphere),
    "eucm": (("alpha", "beta"), extended_unified),
    "ucm": (("alpha",), lambda alpha: extended_unified(alpha, 1.0)),
}


def matches(document: Section) -> bool:
    """True for Basalt's calibration."""
    content = document.content.get("value0")
    return isinstance(content, dict) and "T_imu_cam" in content and "intrinsics" in content


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig of the two cameras. Raises CalibrationError for another number of cameras, or a lens
    model without an equal here.
    """
    whole = document.section("value0")
    poses, lenses = (_two(whole, key) for key in ("T_imu_cam", "intrinsics"))
    sizes = whole.numbers("resolution", 4).reshape(2, 2).astype(int).tolist()
    left, right = (
        _camera(lens, (width, height)) for lens, (width, height) in zip(lenses, sizes, strict=True)
    )
    T_imu_left, T_imu_right = (_pose(pose) for pose in poses)
    with naming(document.where):
        return StereoRig(left, right, inverse(T_imu_right) @ T_imu_left)


def _two(section: Section, key: str) -> list[Section]:
    entries = section.listed(key)
    if len(entries) != 2:
        raise CalibrationError(
            f"{section.where}: {key}: expected two cameras: keep those of the stereo pair"
        )
    return entries


def _camera(section: Section, size: tuple[int, int]) -> Camera:
    name, lens = section.text("camera_type"), section.section("intrinsics")
    if name in OTHERS:
        keys, plane = OTHERS[name]
        shape = [lens.number(key) for key in keys]
        return fitted_camera(section.where, plane(*shape), _matrix(lens), size, name)
    if name not in MODELS:
        raise CalibrationError(
            f"{section.where}: camera_type: {name!r} is not supported: calibrate with "
            f"{' or '.join(MODELS)}"
        )
    model, coefficients = MODELS[name]
    distortion = np.array([lens.number(key) for key in coefficients])
    return make_camera(section.where, _matrix(lens), distortion, size, model)


def _matrix(lens: Section) -> Array:
    return camera_matrix(*(lens.number(key) for key in ("fx", "fy", "cx", "cy")))


def _pose(section: Section) -> Array:
    """Camera to IMU, (4, 4)."""
    quaternion = np.array([section.number(f"q{axis}") for axis in "xyzw"])
    length2 = float(quaternion @ quaternion)
    if not 0.9 < length2 < 1.1:
        raise CalibrationError(
            f"{section.where}: a quaternion of length {np.sqrt(length2):.3g} is not a rotation"
        )
    return rigid_transform(
        rotation_from_quaternion(quaternion),
        np.array([section.number(f"p{axis}") for axis in "xyz"]),
    )


FORMAT = RigFormat(matches, parse)
