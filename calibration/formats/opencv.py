"""OpenCV FileStorage as its stereo_calib sample writes it, in YAML, XML or JSON: M1 D1 M2 D2 and R T, in one file or two.

The sample stores no image size; files written here do, and name the camera model.
"""

from pathlib import Path

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.ros import make_camera, rig_from_projections
from calibration.formats.section import Section
from calibration.rig import Camera, CameraModel, StereoRig

K_NAMES = ("K{}", "M{}", "cameraMatrix{}", "camera_matrix_{}", "camera_matrix{}", "CM{}", "mtx{}")
D_NAMES = ("D{}", "distCoeffs{}", "dist_coeffs_{}", "dist_coeffs{}", "distortion{}", "distCoefs{}", "dist{}")
FISHEYE_NAMES = ("fisheye", "equidistant", "kannala_brandt", "KannalaBrandt8")
Size = tuple[int, int]


def has_intrinsics(document: Section) -> bool:
    """True if the file holds both camera matrices."""
    return all(any(document.has(name.format(side)) for name in K_NAMES) for side in (1, 2))


def has_extrinsics(document: Section) -> bool:
    """True if the file says where the second camera stands."""
    return document.has("R", "T") or document.has("R1", "R2", "P1", "P2")


def matches(document: Section) -> bool:
    """True if one file holds the whole rig, or half of it."""
    return has_intrinsics(document) or has_extrinsics(document)


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig of one file, or of intrinsics and extrinsics merged. image_size: for files that store none."""
    if not has_intrinsics(document):
        raise CalibrationError(
            f"{document.where}: holds no camera matrices (K1, K2): give the intrinsics file too, with a comma between"
        )
    if not has_extrinsics(document):
        raise CalibrationError(
            f"{document.where}: holds no R and T between the cameras: give the extrinsics file too, with a comma between "
            "(two single-camera calibrations hold no stereo geometry)"
        )
    size = _stored_size(document) or image_size
    if size is None:
        raise CalibrationError(
            f"{document.where}: stores no image size (OpenCV's format has none): give the size of the images, "
            "or add the keys image_width and image_height"
        )
    left, right = (_parse_camera(document, side, size) for side in (1, 2))
    if not document.has("R", "T"):
        rotations = [document.matrix(key, 3, 3) for key in ("R1", "R2")]
        return rig_from_projections(left, right, rotations, [document.matrix(key, 3, 4) for key in ("P1", "P2")])
    T = np.eye(4)
    R = document.numbers("R", 9, 3)
    T[:3, :3] = R.reshape(3, 3) if R.size == 9 else cv2.Rodrigues(R)[0]
    T[:3, 3] = document.numbers("T", 3)
    return StereoRig(left, right, T)


def write(rig: StereoRig, path: Path) -> None:
    """Write one FileStorage, in the notation of the path's extension: .yml, .yaml, .xml or .json."""
    if path.suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise CalibrationError(f"{path}: OpenCV writes .yml, .xml or .json, and takes the notation from the extension")
    if rig.left.image_size != rig.right.image_size or rig.left.model != rig.right.model:
        raise CalibrationError(
            "OpenCV's file has one image size and one model for both cameras, and this rig has two: write native"
        )
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    if not storage.isOpened():
        raise CalibrationError(f"{path}: cannot be written")
    width, height = rig.left.image_size
    for key, value in (("image_width", width), ("image_height", height), ("camera_model", rig.left.model)):
        storage.write(key, value)
    for side, camera in ((1, rig.left), (2, rig.right)):
        storage.write(f"K{side}", camera.K)
        storage.write(f"D{side}", camera.distortion[None] if camera.distortion.size else np.zeros((1, 5)))
    storage.write("R", np.ascontiguousarray(rig.R))
    storage.write("T", np.ascontiguousarray(rig.T_right_left[:3, 3:]))
    storage.release()


def _stored_size(document: Section) -> Size | None:
    for width, height in (("image_width", "image_height"), ("imageWidth", "imageHeight"), ("width", "height")):
        if document.has(width, height):
            return document.image_size(width, height)
    for key in ("image_size", "imageSize", "image_Size", "size"):
        if document.has(key):
            return document.image_size(key)
    return None


def _parse_camera(document: Section, side: int, size: Size) -> Camera:
    K = document.matrix(document.first(*(name.format(side) for name in K_NAMES)), 3, 3)
    key = document.first(*(name.format(side) for name in D_NAMES))
    distortion = document.numbers(key)
    return make_camera(f"{document.where}: {key}", K, distortion, size, _model(document, key, distortion.size))


def _model(document: Section, key: str, coefficients: int) -> CameraModel:
    named = next((name for name in ("camera_model", "distortion_model", "model") if document.has(name)), None)
    if named:
        return "fisheye" if document.text(named) in FISHEYE_NAMES else "pinhole"
    if coefficients == 4:
        raise CalibrationError(
            f"{document.where}: {key}: 4 coefficients may be k1 k2 p1 p2 or OpenCV's fisheye, and nothing in the file tells: "
            "add the key camera_model, with pinhole or fisheye"
        )
    return "pinhole"
