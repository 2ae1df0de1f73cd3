"""COLMAP's rigs: rig_config.json of two cameras, or rigs.txt and cameras.txt of a model; camera
from rig, quaternions w first.

Its pixels begin at the corner: the center of the first one is (0.5, 0.5) (COLMAP, *Camera Models*).
"""

from typing import Any

import numpy as np

from calibration.errors import CalibrationError, SizeMissingError
from calibration.formats.cameras import make_camera
from calibration.formats.reading.lens_models import field_of_view, fitted_camera
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import to_meters
from calibration.geometry import Array
from calibration.rig import Camera, CameraModel, StereoRig
from calibration.transforms import inverse, rigid_transform, rotation_from_quaternion

Size = tuple[int, int]
# keys that reading/document.py puts the lines of these files under
CAMERAS, RIGS = ("cameras.txt of COLMAP", "rigs.txt of COLMAP")
MODEL_SCALE = (
    "the rig of a COLMAP model has the scale of the model, which is metric only if it was "
    "scaled: measure a known length, or give the calibrated rig"
)
MODELS: dict[str, tuple[int, tuple[str, ...], CameraModel]] = {
    "SIMPLE_PINHOLE": (1, (), "pinhole"),
    "PINHOLE": (2, (), "pinhole"),
    "SIMPLE_RADIAL": (1, ("k1",), "pinhole"),
    "RADIAL": (1, ("k1", "k2"), "pinhole"),
    "OPENCV": (2, ("k1", "k2", "p1", "p2"), "pinhole"),
    "FULL_OPENCV": (2, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), "pinhole"),
    "SIMPLE_RADIAL_FISHEYE": (1, ("k1",), "fisheye"),
    "RADIAL_FISHEYE": (1, ("k1", "k2"), "fisheye"),
    "OPENCV_FISHEYE": (2, ("k1", "k2", "k3", "k4"), "fisheye"),
    "FOV": (2, ("omega",), "pinhole"),
}
"""A model's focal lengths, its coefficients after the principal point, and what it is here."""


def matches(document: Section) -> bool:
    """True for a rig, and for cameras without one, which parse refuses."""
    of_model = document.has(CAMERAS) or document.has(RIGS)
    return of_model or bool(document.listed("cameras", "image_prefix"))


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rig. image_size: for rig_config.json, which stores none. Raises CalibrationError."""
    try:
        cameras = _cameras(document)
        if document.has(RIGS):
            lenses, poses = _of_model(document, cameras)
        elif configured := document.listed("cameras", "image_prefix"):
            lenses, poses = _of_config(document, configured, cameras, image_size)
        else:
            lenses, poses = [], []
    except (ValueError, IndexError, KeyError) as error:
        raise CalibrationError(
            f"{document.where}: is damaged, or from an unknown version of COLMAP: {error}"
        ) from error
    if not lenses:
        raise CalibrationError(
            f"{document.where}: contains cameras but no rig: give the file of the rig, too, as "
            "rigs.txt,cameras.txt or rig_config.json,cameras.txt"
        )
    T = poses[1] @ inverse(poses[0])
    T[:3, 3], doubts = to_meters(T[:3, 3], None)
    if document.has(RIGS):
        doubts = (
            f"{MODEL_SCALE}: its baseline of {1000 * np.linalg.norm(T[:3, 3]):.1f} mm has the "
            "scale of the model",
            *doubts[1:],
        )
    with naming(document.where):
        try:
            return StereoRig(lenses[0], lenses[1], T, doubts=doubts)
        except CalibrationError as error:
            raise CalibrationError(
                f"{MODEL_SCALE}: {error}" if document.has(RIGS) else str(error)
            ) from error


def _cameras(document: Section) -> dict[int, Camera]:
    rows = document.content.get(CAMERAS, [])
    return {
        int(row[0]): _camera(document.where, row[1], row[4:], (int(row[2]), int(row[3])))
        for row in rows
    }


def _of_config(
    document: Section, configured: list[Section], cameras: dict[int, Camera], size: Size | None
) -> tuple[list[Camera], list[Array]]:
    if len(configured) != 2:
        raise CalibrationError(
            f"{document.where}: cameras: holds {len(configured)}: keep the two of the stereo pair"
        )
    in_order = [cameras[number] for number in sorted(cameras)]
    lenses, poses = [], []
    for i, section in enumerate(configured):
        if section.has("camera_params"):
            if size is None and len(in_order) <= i:
                raise SizeMissingError(
                    f"{document.where}: stores no image size: give the size, or also "
                    "cameras.txt, separated by a comma"
                )
            own_size = in_order[i].image_size if len(in_order) > i else size
            assert own_size
            lenses.append(
                _camera(
                    section.where,
                    section.text("camera_model_name"),
                    section.numbers("camera_params"),
                    own_size,
                )
            )
        elif len(in_order) > i:
            lenses.append(
                cameras[int(section.number("camera_id"))]
                if section.has("camera_id")
                else in_order[i]
            )
        else:
            raise CalibrationError(
                f"{section.where}: no 'camera_params': also give cameras.txt, separated by a comma"
            )
        pose = np.eye(4)
        if section.has("cam_from_rig_rotation", "cam_from_rig_translation"):
            turn = section.numbers("cam_from_rig_rotation", 4)
            shift = section.numbers("cam_from_rig_translation", 3)
            pose = _pose(section.where, np.concatenate([turn, shift]))
        poses.append(pose)
    return lenses, poses


def _of_model(document: Section, cameras: dict[int, Camera]) -> tuple[list[Camera], list[Array]]:
    """RIG_ID NUM_SENSORS REF_TYPE REF_ID, then TYPE ID HAS_POSE and the pose of the others."""
    rows = [row for row in document.content[RIGS] if int(row[1]) == 2]
    if len(rows) != 1 or len(rows[0]) < 14 or rows[0][6] != "1":
        raise CalibrationError(
            f"{document.where}: expected one rig of two cameras with the pose of the second, "
            f"found {len(rows)}"
        )
    numbers = [int(rows[0][3]), int(rows[0][5])]
    if not set(numbers) <= set(cameras):
        raise CalibrationError(
            f"{document.where}: its cameras {numbers} are missing: also give cameras.txt, "
            "separated by a comma"
        )
    return [cameras[number] for number in numbers], [
        np.eye(4),
        _pose(document.where, np.array(rows[0][7:14], dtype=np.float64)),
    ]


def _pose(where: str, numbers: Array) -> Array:
    """(4, 4) of qw qx qy qz tx ty tz."""
    if not 0.9 < np.linalg.norm(np.clip(numbers[:4], -2, 2)) < 1.1:
        raise CalibrationError(f"{where}: the quaternion {numbers[:4].tolist()} is not a rotation")
    return rigid_transform(rotation_from_quaternion(numbers[[1, 2, 3, 0]]), numbers[4:])


def _camera(where: str, name: str, parameters: Any, size: Size) -> Camera:
    if name not in MODELS:
        raise CalibrationError(
            f"{where}: the camera model {name} is not supported: use one of {', '.join(MODELS)}"
        )
    focal_count, coefficients, model = MODELS[name]
    numbers = np.array(parameters, dtype=np.float64)
    if numbers.size != focal_count + 2 + len(coefficients):
        raise CalibrationError(
            f"{where}: {name} takes {focal_count + 2 + len(coefficients)} parameters, got "
            f"{numbers.size}"
        )
    focal = numbers[:focal_count]
    cx, cy = numbers[focal_count : focal_count + 2]
    rest = numbers[focal_count + 2 :]
    K = np.array([[focal[0], 0, cx - 0.5], [0, focal[-1], cy - 0.5], [0, 0, 1]])
    if name == "FOV":
        return fitted_camera(where, field_of_view(float(rest[0])), K, size, name)
    padded = np.pad(rest, (0, max(0, 4 - rest.size))) if rest.size else rest
    return make_camera(where, K, padded, size, model)
