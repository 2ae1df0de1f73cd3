"""Middlebury's calib.txt (2014 and later): a rectified pair, baseline in millimeters, doffs = cx of
the right minus the left.
"""

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.rig import StereoRig
from calibration.transforms import rigid_transform

Size = tuple[int, int]


def matches(document: Section) -> bool:
    """True for a calib.txt."""
    return document.has("cam0", "baseline") and not isinstance(document.content["cam0"], dict)


def parse(document: Section, image_size: Size | None) -> StereoRig:
    """The rectified rig, meters; right principal point = left + doffs (Z = f B / (d + doffs))."""
    stored = document.image_size("width", "height") if document.has("width") else image_size
    size = document.needed_size(stored)
    K_left = document.matrix("cam0", 3, 3)
    K_right = document.matrix("cam1", 3, 3) if document.has("cam1") else K_left.copy()
    doffs_px = document.number("doffs") if document.has("doffs") else K_right[0, 2] - K_left[0, 2]
    if document.has("cam1") and abs(K_right[0, 2] - K_left[0, 2] - doffs_px) > 0.01:
        raise CalibrationError(
            f"{document.where}: doffs: {doffs_px:g} px, but cam1 and cam0 differ by "
            f"{K_right[0, 2] - K_left[0, 2]:g} px in cx: one is wrong"
        )
    K_right[0, 2] = K_left[0, 2] + doffs_px
    T = rigid_transform(np.eye(3), [-document.number("baseline") / 1000, 0, 0])
    left, right = (
        make_camera(document.where, K, np.zeros(0), size, "pinhole") for K in (K_left, K_right)
    )
    with naming(f"{document.where}: baseline (millimeters in this format)"):
        return StereoRig(left, right, T, medium="air")


FORMAT = RigFormat(matches, parse)
