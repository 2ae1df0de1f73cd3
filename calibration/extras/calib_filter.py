"""The ``.calib`` of ACFR's surveys: plain numbers in the order of OpenCV 1's CvCalibFilter.

How many cameras, then for each width and height, K (9), k1 k2 p1 p2, R (9) and t (3) of x = R X +
t. That R and t might be the camera's place instead is left to the images.
"""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.bounded_text import decode_text
from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import rig_in_meters
from calibration.rig import Camera, StereoRig
from calibration.transforms import inverse, rigid_transform

KEY, CAMERA_NUMBERS = "calib_filter", 27


def decode(raw: bytes) -> dict[str, Any] | None:
    """The numbers under KEY; None for what is not such a file."""
    try:
        words = decode_text(raw).split() or [""]
    except UnicodeDecodeError:
        return None
    if not re.fullmatch(r"[1-9](\.0*)?", words[0]) or len(words) < 1 + CAMERA_NUMBERS * int(
        float(words[0])
    ):
        return None
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return None
    return (
        {KEY: numbers}
        if numbers[1] > numbers[3] / 100 > 0
        and numbers[1:3] == [round(one) for one in numbers[1:3]]
        else None
    )


def matches(document: Section) -> bool:
    """True for such numbers."""
    return document.has(KEY)


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig of two cameras; other readings may be. Raises CalibrationError for another number."""
    numbers = document.numbers(KEY)
    if numbers[0] != 2:
        raise CalibrationError(f"{document.where}: holds {numbers[0]:g} cameras, and a rig has two")
    left, right = (
        _camera(document.where, numbers[1 + CAMERA_NUMBERS * i :][:CAMERA_NUMBERS]) for i in (0, 1)
    )
    T = right[1] @ inverse(left[1])
    places = inverse(right[1]) @ left[1]
    with naming(document.where):
        rigs = [
            rig_in_meters(left[0], right[0], one, None, f"R and t as {reading}")
            for one, reading in ((T, "x = R X + t"), (places, "the positions of the cameras"))
        ]
        return rigs[0].with_alternatives(rigs[1:])


def _camera(where: str, numbers: NDArray[np.float64]) -> tuple[Camera, NDArray[np.float64]]:
    size, K, distortion, R, t = np.split(numbers, (2, 11, 15, 24))
    camera = make_camera(
        where, K.reshape(3, 3), distortion, (int(size[0]), int(size[1])), "pinhole"
    )
    return camera, rigid_transform(R.reshape(3, 3), t)


FORMAT = RigFormat(matches, parse, decode)
