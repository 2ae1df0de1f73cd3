"""ORB-SLAM2/3 settings: new keys (Camera1.fx, Stereo.T_c1_c2) and old ones (Camera.bf, LEFT.K)."""

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.finder import find
from calibration.formats.reading.section import Section
from calibration.formats.ros import transform_of_projections
from calibration.geometry import camera_matrix
from calibration.rig import Camera, StereoRig
from calibration.transforms import inverse, rigid_transform

Size = tuple[int, int]


def matches(document: Section) -> bool:
    """True for either generation, but not for settings beside which K1 D1 K2 D2 R T of the images
    before rectification stand under names of another tool.
    """
    if document.has("Camera.fx") and not document.has("Camera2.fx") and not document.has("LEFT.K"):
        return find(document.content).pair("K") is None
    return any(map(document.has, ("Camera.fx", "Camera1.fx"))) or document.has(
        "LEFT.K", "LEFT.R", "RIGHT.K"
    )


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig before rectification where the file holds it, else the rectified one."""
    if document.has("LEFT.K"):
        return _old_raw(document)
    size = document.image_size("Camera.width", "Camera.height")
    if document.has("Camera1.fx") and not _is_rectified(document):
        return _two_cameras(document, size, ("Camera1", "Camera2"), "Stereo.T_c1_c2")
    if document.has("Tlr"):
        return _two_cameras(document, size, ("Camera", "Camera2"), "Tlr")
    return _rectified(document, size)


def _is_rectified(document: Section) -> bool:
    return document.has("Camera.type") and document.text("Camera.type") == "Rectified"


def _old_raw(document: Section) -> StereoRig:
    cameras, rotations, projections = [], [], []
    for side in ("LEFT", "RIGHT"):
        size = document.image_size(f"{side}.width", f"{side}.height")
        K, distortion = document.matrix(f"{side}.K", 3, 3), document.numbers(f"{side}.D")
        cameras.append(make_camera(f"{document.where}: {side}", K, distortion, size, "pinhole"))
        rotations.append(document.matrix(f"{side}.R", 3, 3))
        projections.append(document.matrix(f"{side}.P", 3, 4))
    return StereoRig(cameras[0], cameras[1], transform_of_projections(rotations, projections))


def _two_cameras(
    document: Section, size: Size, names: tuple[str, str], transform: str
) -> StereoRig:
    """Both transforms, T_c1_c2 and Tlr, are the inverse of ours: right to left."""
    left, right = (_camera(document, name, size) for name in names)
    rows = document.numbers(transform, 16, 12)[:12].reshape(3, 4)
    T_left_right = np.vstack([rows, [0, 0, 0, 1]])
    return StereoRig(left, right, inverse(T_left_right))


def _rectified(document: Section, size: Size) -> StereoRig:
    name = "Camera1" if document.has("Camera1.fx") else "Camera"
    camera = _camera(document, name, size)
    if camera.distortion.any():
        raise CalibrationError(
            f"{document.where}: {name}.k1: a rectified camera has no distortion, and LEFT.K and "
            "RIGHT.K are missing"
        )
    if document.has("Stereo.b"):
        baseline_m = document.number("Stereo.b")
    else:
        baseline_m = document.number(document.first("Camera.bf", "Stereo.b")) / camera.K[0, 0]
    return StereoRig(camera, camera, rigid_transform(np.eye(3), [-baseline_m, 0, 0]))


def _camera(document: Section, name: str, size: Size) -> Camera:
    K = camera_matrix(*(document.number(f"{name}.{key}") for key in ("fx", "fy", "cx", "cy")))
    fisheye = document.has("Camera.type") and document.text("Camera.type") == "KannalaBrandt8"
    keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    distortion = np.array([document.number(f"{name}.{key}", 0.0) for key in keys])
    return make_camera(
        f"{document.where}: {name}", K, distortion, size, "fisheye" if fisheye else "pinhole"
    )


FORMAT = RigFormat(matches, parse)
