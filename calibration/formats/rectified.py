"""Files with one lens and a baseline, number by number (``fx``, ``cx``, ``cy``, ``baseline``): of images that are rectified
already.
"""

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.ros import make_camera
from calibration.formats.scalars import CENTER_X, CENTER_Y, FOCAL_X, FOCAL_Y, first, numbers_of
from calibration.formats.section import Section, naming
from calibration.formats.units import to_meters
from calibration.rig import StereoRig

BASELINES = {"baseline": None, "stereobaseline": None, "baselinem": "m", "baselinemm": "mm", "baselinecm": "cm"}
"""Spelling -> unit that it names."""
SIZES = (("width", "height"), ("imagewidth", "imageheight"), ("w", "h"))
LEAST_FOCAL_PX = 10.0
"""A focal length of less is in millimeters."""


def matches(document: Section) -> bool:
    """True for a file with a focal length in pixels, a principal point and a baseline, and no distortion."""
    numbers = numbers_of(document.content)
    known = all(first(numbers, names) is not None for names in (CENTER_X, CENTER_Y, tuple(BASELINES)))
    straight = not any(numbers.get(key) for key in ("k1", "k2", "p1", "p2"))
    return known and straight and (first(numbers, FOCAL_X) or 0.0) > LEAST_FOCAL_PX


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rectified rig, the right camera to the right of the left one. Raises CalibrationError."""
    numbers = numbers_of(document.content)
    sizes = [(int(numbers[w]), int(numbers[h])) for w, h in SIZES if w in numbers and h in numbers]
    size = sizes[0] if sizes else image_size
    if size is None:
        raise CalibrationError(f"{document.where}: stores no image size: give the size of the images, or add width and height")
    fx, cx, cy = (first(numbers, names) or 0.0 for names in (FOCAL_X, CENTER_X, CENTER_Y))
    K = np.array([[fx, 0, cx], [0, first(numbers, FOCAL_Y) or fx, cy], [0, 0, 1]])
    name = next(name for name in BASELINES if name in numbers)
    shift, doubts = to_meters(np.array([-abs(numbers[name]), 0, 0]), BASELINES[name])
    T = np.eye(4)
    T[:3, 3] = shift
    camera = make_camera(document.where, K, np.zeros(0), size, "pinhole")
    doubt = "one lens and a baseline: both cameras are taken for alike, and the images for rectified"
    with naming(document.where):
        return StereoRig(camera, camera, T, doubts=(doubt, *doubts))
