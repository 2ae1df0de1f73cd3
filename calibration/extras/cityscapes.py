"""Cityscapes' camera.json: one intrinsic for both rectified cameras, the baseline in meters."""

import numpy as np

from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.section import Section, naming
from calibration.geometry import camera_matrix
from calibration.rig import StereoRig
from calibration.transforms import rigid_transform


def matches(document: Section) -> bool:
    """True for a camera.json."""
    inner = [document.content.get(key) for key in ("extrinsic", "intrinsic")]
    return (
        all(isinstance(value, dict) for value in inner)
        and "baseline" in inner[0]  # type: ignore[operator]
        and "u0" in inner[1]  # type: ignore[operator]
    )


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rectified rig. image_size: (width, height); the data set's own where not given."""
    lens = document.section("intrinsic")
    K = camera_matrix(*(lens.number(key) for key in ("fx", "fy", "u0", "v0")))
    camera = make_camera(lens.where, K, np.zeros(0), image_size or (2048, 1024), "pinhole")
    T = rigid_transform(np.eye(3), [-document.section("extrinsic").number("baseline"), 0, 0])
    with naming(document.where):
        return StereoRig(camera, camera, T, medium="air")


FORMAT = RigFormat(matches, parse)
