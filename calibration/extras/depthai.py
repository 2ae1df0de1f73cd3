"""Luxonis' JSON of an OAK camera's EEPROM (``eepromToJson``): a camera a socket, extrinsics to
another socket, centimeters.
"""

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.rig import Camera, StereoRig
from calibration.transforms import inverse, rigid_transform

LEFT, RIGHT = 1, 2  # sockets of the stereo pair where the file does not name them
MODELS = {0: "perspective", 1: "fisheye"}


def matches(document: Section) -> bool:
    """True for an OAK's calibration."""
    return isinstance(document.content.get("cameraData"), list)


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig of the two stereo cameras. Raises CalibrationError, naming the key."""
    sockets = _sockets(document)
    left, right = (_section(document, socket) for socket in sockets)
    from_left, from_right = (section.section("extrinsics") for section in (left, right))
    if from_left.number("toCameraSocket") == sockets[1]:
        T = _transform(from_left)
    elif from_right.number("toCameraSocket") == sockets[0]:
        T = inverse(_transform(from_right))
    else:
        raise CalibrationError(
            f"{document.where}: no extrinsics lead from socket {sockets[0]} to {sockets[1]}: "
            "calibrate the pair"
        )
    with naming(document.where):
        return StereoRig(_camera(left), _camera(right), T, "air")


def _sockets(document: Section) -> tuple[int, int]:
    if not document.has("stereoRectificationData"):
        return LEFT, RIGHT
    stereo = document.section("stereoRectificationData")
    left, right = (int(stereo.number(f"{side}CameraSocket")) for side in ("left", "right"))
    return (left, right) if min(left, right) >= 0 else (LEFT, RIGHT)


def _section(document: Section, socket: int) -> Section:
    for entry in document.content["cameraData"]:
        if (
            isinstance(entry, list)
            and len(entry) == 2
            and entry[0] == socket
            and isinstance(entry[1], dict)
        ):
            return Section(f"{document.where}: cameraData: {socket}", entry[1])
    raise CalibrationError(
        f"{document.where}: cameraData: holds no camera of socket {socket}, which is one of the "
        "stereo pair"
    )


def _transform(extrinsics: Section) -> NDArray[np.float64]:
    translation = extrinsics.section("translation")
    T_m = np.array([translation.number(axis) for axis in "xyz"]) / 100
    return rigid_transform(extrinsics.matrix("rotationMatrix", 3, 3), T_m)


def _camera(section: Section) -> Camera:
    size = section.image_size("width", "height")
    model = MODELS.get(int(section.number("cameraType", 0.0)))
    if model is None:
        raise CalibrationError(
            f"{section.where}: cameraType: {section.number('cameraType'):g} is not supported: "
            "perspective or fisheye"
        )
    distortion = section.numbers("distortionCoeff")
    return make_camera(
        section.where,
        section.matrix("intrinsicMatrix", 3, 3),
        distortion[:4] if model == "fisheye" else distortion,
        size,
        "fisheye" if model == "fisheye" else "pinhole",
    )


FORMAT = RigFormat(matches, parse)
