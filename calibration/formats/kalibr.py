"""Kalibr's camchain: meters, x_cam1 = T_cn_cnm1 x_cam0; omni, ds, eucm and fov become the pinhole
or fisheye that is nearest.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from calibration.errors import CalibrationError
from calibration.formats.cameras import make_camera
from calibration.formats.kalibr_results import stated_errors
from calibration.formats.reading.lens_models import (
    Plane,
    double_sphere,
    extended_unified,
    field_of_view,
    fitted_camera,
    omni,
)
from calibration.formats.reading.section import Section, naming
from calibration.geometry import Array, camera_matrix
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse, is_backward

DISTORTION_MODELS: dict[str, CameraModel] = {
    "radtan": "pinhole",
    "equidistant": "fisheye",
    "none": "pinhole",
    "plumb_bob": "pinhole",  # these two of ROS, in chains that other tools write
    "rational_polynomial": "pinhole",
}


def matches(document: Section) -> bool:
    """True for a camchain, of any number of cameras."""
    content = document.content.get("cam0")
    # TagSLAM
    return (
        isinstance(content, dict)
        and ("intrinsics" in content or "camera_model" in content)
        and "pose" not in content
    )


def parse(document: Section) -> StereoRig:
    """The rig of cam0 and cam1. If cam1 stands to the left of cam0, it becomes the left camera."""
    if document.has("cam2"):
        raise CalibrationError(
            f"{document.where}: holds more than two cameras: keep the two of the stereo pair, as "
            "cam0 and cam1"
        )
    if not document.has("cam1"):
        raise CalibrationError(
            f"{document.where}: contains only cam0: calibrate both cameras together"
        )
    sections = [document.section("cam0"), document.section("cam1")]
    cameras = [_parse_camera(section) for section in sections]
    T = _pose(sections)
    topics = [section.text("rostopic") if section.has("rostopic") else "" for section in sections]
    errors = stated_errors(
        Path(document.where), np.array([camera.K[[0, 1], [0, 1]] for camera in cameras])
    )
    with naming(sections[1].where + ": T_cn_cnm1"):
        if is_backward(T):
            _check_topics(topics[::-1])
            return StereoRig(cameras[1], cameras[0], inverse(T), errors=errors)
        _check_topics(topics)
        return StereoRig(cameras[0], cameras[1], T, errors=errors)


def _pose(sections: list[Section]) -> Array:
    """T_cn_cnm1, (4, 4); else from each camera's pose to an IMU (OpenVINS writes T_imu_cam)."""
    if not sections[1].has("T_cn_cnm1"):
        for key in ("T_cam_imu", "T_imu_cam"):
            if all(section.has(key) for section in sections):
                left, right = (section.matrix(key, 4, 4) for section in sections)
                return right @ inverse(left) if key == "T_cam_imu" else inverse(right) @ left
    return sections[1].matrix("T_cn_cnm1", 4, 4)


def write(rig: StereoRig, path: Path) -> None:
    """Write a camchain.

    Raises CalibrationError for a camera that Kalibr has no model for (skew, k3, rational or thin
    prism distortion), and for a rig that reading refuses.
    """
    if is_backward(rig.T_right_left):
        raise CalibrationError(
            "the right camera stands to the left of the left one, which in a Kalibr file means "
            "that left and right are swapped: exchange the sides, or write another format"
        )
    left = _camera_content(rig.left, "left") | {"cam_overlaps": [1], "rostopic": "/left/image_raw"}
    right = {"T_cn_cnm1": rig.T_right_left.tolist()} | _camera_content(rig.right, "right")
    content = {"cam0": left, "cam1": right | {"cam_overlaps": [0], "rostopic": "/right/image_raw"}}
    path.write_text(
        yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8"
    )


def _parse_camera(section: Section) -> Camera:
    model = section.text("camera_model") if section.has("camera_model") else "pinhole"
    name = section.text("distortion_model") if section.has("distortion_model") else "none"
    if model != "pinhole" or name == "fov":
        return _other_lens(section, model, name)
    if name not in DISTORTION_MODELS:
        raise CalibrationError(
            f"{section.where}: distortion_model: {name!r} is not supported: calibrate with radtan "
            "or equidistant"
        )
    K = camera_matrix(*section.numbers("intrinsics", 4))
    count = [4] if name in ("radtan", "equidistant") else []
    distortion = np.zeros(0) if name == "none" else section.numbers("distortion_coeffs", *count)
    return make_camera(
        section.where, K, distortion, section.image_size("resolution"), DISTORTION_MODELS[name]
    )


def _other_lens(section: Section, model: str, name: str) -> Camera:
    """A lens that OpenCV has no model for: the lens's parameters precede the focal lengths."""
    count = {"omni": 1, "ds": 2, "eucm": 2, "pinhole": 0}.get(model)
    if (
        count is None
        or (model != "omni" and name not in ("none", "fov"))
        or name not in ("none", "radtan", "fov")
    ):
        raise CalibrationError(
            f"{section.where}: camera_model: {model!r} with {name!r} is not supported: "
            "calibrate with pinhole-radtan or pinhole-equi"
        )
    numbers = section.numbers("intrinsics", count + 4)
    shape, K = numbers[:count].tolist(), camera_matrix(*numbers[count:])
    distortion = section.numbers("distortion_coeffs", 4) if name == "radtan" else np.zeros(4)
    planes: dict[str, Callable[[], Plane]] = {
        "omni": lambda: omni(shape[0], distortion),
        "ds": lambda: double_sphere(*shape),
        "eucm": lambda: extended_unified(*shape),
        "pinhole": lambda: field_of_view(section.number("distortion_coeffs")),
    }
    return fitted_camera(
        section.where, planes[model](), K, section.image_size("resolution"), f"{model}-{name}"
    )


def _check_topics(topics: list[str]) -> None:
    if "right" in topics[0].lower() and "left" in topics[1].lower():
        raise CalibrationError(
            f"the camera of topic {topics[0]!r} stands to the left of {topics[1]!r}: "
            "left and right are swapped, or the transform is inverted"
        )


def _camera_content(camera: Camera, side: str) -> dict[str, Any]:
    K, distortion = camera.K, camera.distortion
    if K[0, 1] != 0:
        raise CalibrationError(f"{side}: Kalibr has no skew, but K of this camera has one")
    if camera.model == "pinhole" and distortion[4:].any():
        raise CalibrationError(
            f"{side}: Kalibr's radtan has only k1 k2 p1 p2, but this camera has more "
            "coefficients: write another format"
        )
    return {
        "camera_model": "pinhole",
        "intrinsics": [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])],
        "distortion_model": "equidistant" if camera.model == "fisheye" else "radtan",
        "distortion_coeffs": np.pad(distortion[:4], (0, 4 - distortion[:4].size)).tolist(),
        "resolution": list(camera.image_size),
    }
