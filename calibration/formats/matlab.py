"""MATLAB's ``stereoParameters``: the object as ``save`` writes it, or the struct of ``toStruct``.

MATLAB multiplies row vectors from the left, x2 = x1 * RotationOfCamera2 + TranslationOfCamera2
(MathWorks, *stereoParameters*), so its matrices are the transposes of ours, and its pixels begin at
1. From R2022b on ``K`` and ``PoseCamera2`` hold the matrices as we do. Some tools fill
RotationOfCamera2 without transposing; where nothing else in the file decides, the rig carries both
readings.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.cameras import five_coefficients, make_camera
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import rig_in_meters
from calibration.geometry import Array
from calibration.rig import Camera, StereoRig
from calibration.transforms import rigid_transform

Size = tuple[int, int]
# of matrix entries: MATLAB writes 16 digits, and R and its transpose differ by far more
SAME_ROTATION = 1e-6
HOLDS = "MATLAB has only k1 k2 k3 p1 p2"
DOCUMENTED = "RotationOfCamera2 read as MATLAB documents it, for row vectors"
TRANSPOSED = "RotationOfCamera2 read as R of x2 = R x1 + T, not transposed"
_OF_LENS = (
    "IntrinsicMatrix", "K", "FocalLength", "PrincipalPoint", "Skew", "RadialDistortion",
    "TangentialDistortion",
)  # fmt: skip
_OF_CAMERA = {
    name.lower(): name for name in (*_OF_LENS, "ImageSize", "WorldUnits", "RotationVectors")
}
_OF_PAIR = {
    name.lower(): name for name in ("RotationOfCamera2", "TranslationOfCamera2", "PoseCamera2")
}
_NUMBERED = re.compile(rf"(?:camera(?:parameters|params)?([12]))?({'|'.join(_OF_CAMERA)})([12])?")
"""A property of one camera as a variable: ``IntrinsicMatrix1``, ``camera2_RadialDistortion``."""


def matches(document: Section) -> bool:
    """True if the file holds stereoParameters, as an object or as a struct, under any name."""
    return _find(document) is not None


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig. image_size: for files of MATLAB before R2018, which may store none.

    Raises CalibrationError, naming the field.
    """
    stereo = _find(document)
    assert stereo is not None
    sections = [stereo.section("CameraParameters1"), stereo.section("CameraParameters2")]
    left, right = (_camera(section, image_size) for section in sections)
    T, unit = _translation(stereo), _unit(sections[0])
    readings = _rotations(stereo, document, sections)
    with naming(stereo.where):
        rigs = [
            rig_in_meters(left, right, rigid_transform(R, T), unit, reading)
            for reading, R in readings
        ]
        return rigs[0].with_alternatives(rigs[1:])


def write(rig: StereoRig, path: Path) -> None:
    """Write the struct that MATLAB's ``stereoParameters(s)`` takes, and beside it the fields of
    Bouguet's toolbox.

    Millimeters, pixels from 1 in the struct and from 0 in Bouguet's fields, as their owners have
    it.
    Raises CalibrationError for a camera that MATLAB has no model for (fisheye, rational or thin
    prism distortion).
    """
    cameras = [
        _camera_content(camera, side) for camera, side in ((rig.left, "left"), (rig.right, "right"))
    ]
    translation_mm = rig.T_right_left[:3, 3] * 1000
    stereo = {
        "CameraParameters1": cameras[0],
        "CameraParameters2": cameras[1],
        "RotationOfCamera2": rig.R.T,
        "TranslationOfCamera2": translation_mm[None],
    }
    content: dict[str, Any] = {
        "stereoParams": stereo,
        "om": cv2.Rodrigues(rig.R)[0],
        "R": rig.R,
        "T": translation_mm[:, None],
    }
    for camera, side in ((rig.left, "left"), (rig.right, "right")):
        (fx, skew, cx), (_, fy, cy), _ = camera.K.tolist()
        content |= {
            f"fc_{side}": [[fx], [fy]],
            f"cc_{side}": [[cx], [cy]],
            f"alpha_c_{side}": skew / fx,
        }
        content[f"kc_{side}"] = five_coefficients(camera, side, HOLDS)[:, None]
    width, height = rig.left.image_size
    from scipy.io import savemat  # half a second, which reading need not wait for

    savemat(path, content | {"nx": width, "ny": height}, do_compression=True, appendmat=False)


def _find(document: Section) -> Section | None:
    pending = [(document, 0)]
    while pending:
        section, depth = pending.pop()
        if section.has("CameraParameters1", "CameraParameters2"):
            return section
        if (gathered := _gathered(section)) is not None:
            return gathered
        if depth < 2:
            inner = (
                (name, value) for name, value in section.content.items() if isinstance(value, dict)
            )
            pending += [
                (Section(f"{section.where}: {name}", value), depth + 1) for name, value in inner
            ]
    return None


def _gathered(section: Section) -> Section | None:
    """The properties of stereoParameters that were saved each by itself, numbered; else None."""
    cameras: tuple[dict[str, Any], dict[str, Any]] = ({}, {})
    rest: dict[str, Any] = {}
    for key, value in section.content.items():
        bare = re.sub(r"[\W_]", "", str(key)).lower()
        found = _NUMBERED.fullmatch(bare)
        if found is None:
            rest[_OF_PAIR.get(bare, key)] = value
            continue
        number = found[1] or found[3]
        for camera in [cameras[int(number) - 1]] if number else cameras:
            camera.setdefault(_OF_CAMERA[found[2]], value)
    if not all(map(_is_camera, cameras)) or not rest.keys() & {"PoseCamera2", "RotationOfCamera2"}:
        return None
    return Section(
        section.where, {**rest, "CameraParameters1": cameras[0], "CameraParameters2": cameras[1]}
    )


def _is_camera(content: Mapping[str, Any]) -> bool:
    return "RadialDistortion" in content and bool(
        content.keys() & {"IntrinsicMatrix", "K", "FocalLength"}
    )


def _camera(section: Section, image_size: Size | None) -> Camera:
    if section.has("K"):
        K = section.matrix("K", 3, 3)
    elif section.has("IntrinsicMatrix"):
        K = section.matrix("IntrinsicMatrix", 3, 3)
        K = (K if K[:2, 2].any() else K.T).copy()  # where somebody has transposed it already
    elif section.has("FocalLength", "PrincipalPoint"):  # a cameraIntrinsics object
        (fx, fy), (cx, cy) = section.numbers("FocalLength", 2), section.numbers("PrincipalPoint", 2)
        K = np.array([[fx, section.number("Skew", 0.0), cx], [0, fy, cy], [0, 0, 1]])
    else:
        raise CalibrationError(
            f"{section.where}: no 'K' (nor IntrinsicMatrix): MATLAB's fisheye and other models are "
            "not supported; calibrate with the standard model"
        )
    K[:2, 2] -= 1  # MATLAB's first pixel is 1
    radial = section.numbers("RadialDistortion", 2, 3)
    tangential = section.numbers("TangentialDistortion", 2)
    distortion = np.concatenate([radial[:2], tangential, np.pad(radial[2:], (0, 3 - radial.size))])
    return make_camera(section.where, K, distortion, _size(section, image_size), "pinhole")


def _size(section: Section, image_size: Size | None) -> Size:
    if section.has("ImageSize") and section.numbers("ImageSize").size:
        height, width = section.image_size("ImageSize")
        return width, height
    return section.needed_size(image_size)


def _translation(stereo: Section) -> Array:
    if stereo.has("TranslationOfCamera2"):
        return stereo.numbers("TranslationOfCamera2", 3)
    return _pose(stereo)[:3, 3]


def _pose(stereo: Section) -> Array:
    """(4, 4) of PoseCamera2: a rigidtform3d, which releases save by different names, as a matrix or
    as rotation and translation.

    The matrix of a rigid3d is for row vectors, with the translation in its last row.
    """
    pose = stereo.section("PoseCamera2")
    sizes = {pose.size(key): key for key in reversed(list(pose.content))}
    if 16 in sizes:
        matrix = pose.matrix(sizes[16], 4, 4)
        return matrix.T if matrix[3, :3].any() else matrix
    if 9 not in sizes or 3 not in sizes:
        raise CalibrationError(
            f"{pose.where}: holds no rotation and translation (its keys: "
            f"{', '.join(pose.content)[:100]})"
        )
    return rigid_transform(pose.matrix(sizes[9], 3, 3), pose.numbers(sizes[3], 3))


def _unit(camera: Section) -> str | None:
    unit = camera.content.get("WorldUnits")
    return unit if isinstance(unit, str) and unit else None


def _rotations(
    stereo: Section, document: Section, cameras: list[Section]
) -> list[tuple[str, Array]]:
    """R of x2 = R x1 + T, and how it was read; two where the file leaves the convention open."""
    if stereo.has("PoseCamera2") and isinstance(stereo.content["PoseCamera2"], dict):
        return [("", _pose(stereo)[:3, :3])]
    stored = stereo.matrix("RotationOfCamera2", 3, 3)
    readings = [(DOCUMENTED, stored.T.copy()), (TRANSPOSED, stored)]
    witness = document.matrix("R", 3, 3) if document.has("R") else _rotation_by_views(cameras)
    if witness is not None:
        readings.sort(key=lambda reading: float(np.abs(reading[1] - witness).max()))
        return readings[:1]
    return readings if np.abs(stored - stored.T).max() > SAME_ROTATION else [("", stored.T.copy())]


def _rotation_by_views(cameras: list[Section]) -> Array | None:
    """The rotation between the cameras by the poses of the board that the file keeps; their
    rotation vectors are column-wise.
    """
    if not all(camera.has("RotationVectors") for camera in cameras):
        return None
    left, right = (camera.numbers("RotationVectors") for camera in cameras)
    if left.size < 3 or left.size != right.size or left.size % 3:
        return None
    R_left, R_right = (cv2.Rodrigues(vectors.reshape(-1, 3)[0])[0] for vectors in (left, right))
    return np.asarray(R_right @ R_left.T, dtype=np.float64)


def _camera_content(camera: Camera, side: str) -> dict[str, Any]:
    k1, k2, p1, p2, k3 = five_coefficients(camera, side, HOLDS).tolist()
    width, height = camera.image_size
    K = camera.K.copy()
    K[:2, 2] += 1
    return {
        "IntrinsicMatrix": K.T,
        "RadialDistortion": [[k1, k2, k3]],
        "TangentialDistortion": [[p1, p2]],
        "ImageSize": [[float(height), float(width)]],
        "WorldUnits": "mm",
        "EstimateSkew": bool(camera.skew),
        "NumRadialDistortionCoefficients": 3.0,
        "EstimateTangentialDistortion": True,
    }
