"""calib.io's JSON: OpenCV's lens, and each camera's transform, in the sense that images decide."""

from collections.abc import Iterator, Mapping
from typing import Any

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import rig_in_meters
from calibration.geometry import Array, camera_matrix
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse, rigid_transform

MODELS: dict[str, tuple[CameraModel, tuple[str, ...]]] = {
    "libCalib::CameraModelOpenCV": (
        "pinhole", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX",
        "tauY")
    ),
    "libCalib::CameraModelOpenCVFisheye": ("fisheye", ("k1", "k2", "k3", "k4")),
}  # fmt: skip
SHORTER = (5, 8, 12, 14)
"""Numbers of coefficients of a pinhole."""


def matches(document: Section) -> bool:
    """True for what Calibration > cameras holds."""
    content = document.content.get("Calibration", document.content)
    cameras = content.get("cameras") if isinstance(content, Mapping) else None
    return isinstance(cameras, list) and "polymorphic_name" in str(cameras[:1])


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig. Raises CalibrationError for other than two cameras, or an unknown lens model."""
    whole = document.section("Calibration") if document.has("Calibration") else document
    sections = whole.listed("cameras")
    if len(sections) != 2:
        raise CalibrationError(
            f"{whole.where}: holds {len(sections)} cameras: export only the stereo pair"
        )
    left, right = map(_camera, sections)
    poses = [_pose(section.section("transform")) for section in sections]
    T = poses[1] @ inverse(poses[0])
    places = inverse(poses[1]) @ poses[0]
    with naming(document.where):
        rigs = [
            rig_in_meters(left, right, one, None, f"transforms {reading}")
            for one, reading in (
                (places, "as the positions of the cameras"),
                (T, "into the cameras"),
            )
        ]
        return rigs[0].with_alternatives(rigs[1:])


def _pose(transform: Section) -> Array:
    turn, place = transform.section("rotation"), transform.section("translation")
    R = cv2.Rodrigues(np.array([turn.number(key) for key in ("rx", "ry", "rz")]))[0]
    return rigid_transform(R, np.array([place.number(key) for key in "xyz"]))


def _camera(section: Section) -> Camera:
    model = section.section("model")
    name = model.text("polymorphic_name")
    if name not in MODELS:
        raise CalibrationError(
            f"{model.where}: {name} is not supported: calibrate with OpenCV's lens, or its fisheye"
        )
    kind, coefficients = MODELS[name]
    data = model.section("ptr_wrapper").section("data")
    parameters = data.section("parameters")
    f, aspect, cx, cy = (_value(parameters, key) for key in ("f", "ar", "cx", "cy"))
    distortion = np.array(
        [_value(parameters, key) if parameters.has(key) else 0.0 for key in coefficients]
    )
    if kind == "pinhole":
        distortion = distortion[: next(count for count in SHORTER if not distortion[count:].any())]
    size = next(_sizes(data), None)
    if size is None:
        raise CalibrationError(
            f"{data.where}: no imageSize: the file is incomplete or of another kind"
        )
    K = camera_matrix(f, f * aspect, cx, cy)
    return make_camera(section.where, K, distortion, size, kind)


def _value(parameters: Section, key: str) -> float:
    return parameters.section(key).number("val")


def _sizes(section: Section) -> Iterator[tuple[int, int]]:
    """Image sizes anywhere in the lens: its place differs between versions."""
    for key, value in section.content.items():
        if isinstance(value, Mapping):
            inner: Any = section.section(key)
            if key == "imageSize":
                yield inner.image_size("width", "height")
            else:
                yield from _sizes(inner)


FORMAT = RigFormat(matches, parse)
