"""Mistakes in calibrations and in the order of files: what each does to points, its text, and what
to do. ``mistakes`` tests them on points of the raw images.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry import Array
from calibration.rig import Camera, StereoRig
from calibration.transforms import inverse, rigid_transform

Flip = tuple[bool, bool]
"""Which axes of a side's images run the other way, x and y."""


@dataclass(frozen=True, eq=False)
class Mistake:
    """What was done with a calibration or with images. make: the calibration without it; raises
    CalibrationError where it is none. left, right: flips of the images.
    """

    what: str
    fix: str
    make: Callable[[StereoRig], StereoRig]
    left: Flip = (False, False)
    right: Flip = (False, False)

    @property
    def is_mirrored(self) -> bool:
        """Tell whether images are mirrored along one axis."""
        return any(sum(flip) == 1 for flip in (self.left, self.right))


EXCHANGED = "left and right look swapped"
EXCHANGE = (
    "exchange --left and --right (of images that show both sides: change "
    "input.right_half_first), or the cameras in the calibration, if it lists the right one first"
)
RECTIFIED = "the images are rectified already"
GIVE_RECTIFIED = (
    "give the calibration of the rectified images (rectified.yaml, P of ROS, P1 and P2 of OpenCV, "
    "or one focal length without distortion and rotation), or the raw images"
)
WRONG_WAY = "the translation between the cameras points the wrong way, in the calibration"
REVERSE = "use -T, or -R T if it is the position of the right camera"
TURNED, MIRRORED, MIRRORED_DOWN = (True, True), (True, False), (False, True)
_AS_IT_IS = (False, False)


def _transformed(change: Callable[[Array, Array], tuple[Array, Array]]) -> Callable[..., StereoRig]:
    """change: rotation and translation between the cameras -> those without the mistake."""

    def make(rig: StereoRig) -> StereoRig:
        R, t = change(rig.T_right_left[:3, :3], rig.T_right_left[:3, 3])
        return replace(rig, T_right_left=rigid_transform(R, t))

    return make


def _with_lenses_exchanged(rig: StereoRig) -> StereoRig:
    return replace(rig, left=rig.right, right=rig.left)


def _exchanged(rig: StereoRig) -> StereoRig:
    T = inverse(rig.T_right_left)
    return replace(rig, left=rig.right, right=rig.left, T_right_left=T)


def rectified_like(rig: StereoRig) -> StereoRig:
    """A rig of rectified images, of this one's baseline; focal length and center are not theirs.

    Raises CalibrationError for a rig without distortion, of which a moved camera comes to the same.
    """
    distorted = rig.left.distortion.any() and rig.right.distortion.any()
    if not distorted or rig.left.image_size != rig.right.image_size:
        raise CalibrationError("no mistake")
    camera = Camera(rig.left.K, np.zeros(0), rig.left.image_size)
    along = np.eye(3)[int(np.abs(rig.T_right_left[:2, 3]).argmax())]
    shift = np.copysign(rig.baseline_m, rig.T_right_left[:3, 3]) * along
    return replace(rig, left=camera, right=camera, T_right_left=rigid_transform(np.eye(3), shift))


def _images(sides: str, how: str, fix: str, left: Flip, right: Flip) -> Mistake:
    what = f"the {sides} images are {how} relative to the calibration"
    return Mistake(what, fix, lambda rig: rig, left, right)


_FLIPS = (
    (
        "rotated by 180 degrees",
        "rotate them as for the calibration (or remove their EXIF orientation, if the calibration "
        "was made without it)",
        TURNED,
    ),
    ("mirrored, left to right,", "mirror them back", MIRRORED),
    ("mirrored, top to bottom,", "mirror them back", MIRRORED_DOWN),
)
MISTAKES = (
    Mistake(EXCHANGED, EXCHANGE, _exchanged),
    Mistake(RECTIFIED, GIVE_RECTIFIED, rectified_like),
    Mistake(
        "the transform between the cameras is the inverse one, right to left, in the calibration",
        "invert it (R transposed, T = -R^T T)",
        _transformed(lambda R, t: (R.T, -R.T @ t)),
    ),
    Mistake(
        "the rotation between the cameras is transposed, in the calibration",
        "transpose R, and leave T",
        _transformed(lambda R, t: (R.T, t)),
    ),
    Mistake(WRONG_WAY, REVERSE, _transformed(lambda R, t: (R, -t))),
    Mistake(WRONG_WAY, REVERSE, _transformed(lambda R, t: (R, -R @ t))),
    Mistake(
        "the lenses of left and right are exchanged in the calibration",
        "exchange K and distortion, and leave R and T",
        _with_lenses_exchanged,
    ),
    *(
        _images(sides, how, fix, flip if "left" in sides else _AS_IT_IS, right)
        for how, fix, flip in _FLIPS
        for sides, right in (("left", _AS_IT_IS), ("right", flip), ("left and right", flip))
    ),
)
"""The most usual first."""
