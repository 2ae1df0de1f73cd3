"""Files with one lens and a baseline, of images that are rectified already: ``fx``, ``cx``, ``cy``,
``baseline``, or a matrix.
"""

import numpy as np

from calibration.formats.cameras import make_camera
from calibration.formats.opencv import size_of
from calibration.formats.reading.aliases import METERS
from calibration.formats.reading.finder import find
from calibration.formats.reading.leaves import words
from calibration.formats.reading.poses import has_pose
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import to_meters
from calibration.rig import StereoRig
from calibration.transforms import rigid_transform


def matches(document: Section) -> bool:
    """True for a file with a camera matrix and a baseline, and no distortion."""
    parts = find(document.content)
    straight = (D := parts.get("D")) is None or not D.numbers.any()
    return (
        bool(parts.get("K") and parts.get("baseline"))
        and straight
        and not has_pose(document, parts)
    )


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rectified rig, the right camera to the right of the left one. Raises CalibrationError."""
    parts = find(document.content)
    lens, baseline = parts.get("K"), parts.get("baseline")
    assert lens
    assert baseline
    K = lens.finite(document.where).reshape(3, 3)
    unit = next((word for word in words(baseline.path[-1]) if word in METERS), None)
    shift, doubts = to_meters(np.array([-abs(baseline.finite(document.where)[0]), 0, 0]), unit)
    camera = make_camera(
        document.where, K, np.zeros(0), size_of(document, parts, "left", K, image_size), "pinhole"
    )
    doubt = (
        "one lens and a baseline: the cameras are assumed to be equal, and the images to be "
        "rectified"
    )
    with naming(document.where):
        return StereoRig(camera, camera, rigid_transform(np.eye(3), shift), doubts=(doubt, *doubts))
