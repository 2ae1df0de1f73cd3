"""What may differ between a calibration and the images of a dive, each with an amount.

``causes`` tests them against each other on rows and motion. The length of the baseline is not in
the table: no image shows it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.port import DESCRIBE_PORT, FLAT_PORT, flat_port
from calibration.rectification import upright_rotations
from calibration.rig import Camera, StereoRig
from calibration.transforms import rigid_transform


@dataclass(frozen=True)
class Amount:
    """How much of a cause there may be. unit: of the text, 1 = as it is. step: small enough to be
    linear. most, least: larger and smaller ones are not plausible. zero: what the text adds to an
    amount, NaN where it gives the amount itself, with its sign.
    """

    unit: float
    step: float
    most: float
    least: float = 0.0
    zero: float = float("nan")

    def text(self, amount: float) -> str:
        """The amount as texts give it."""
        if self.zero == self.zero:
            return f"{self.zero + self.unit * amount:.2f}"
        shown = self.unit * amount
        return f"{shown:+.0f}" if abs(shown) >= 100 else f"{shown:+.2g}"


@dataclass(frozen=True)
class Cause:
    """A cause tested in proportion to its amount. text: with the amount and its standard error;
    below: the same of amounts below zero, "" for no other.

    make: the rig that took the images, if an amount of it has happened to the calibrated one; None
    for shutters, which no rig has.
    """

    text: str
    amount: Amount
    cure: str
    make: Callable[[StereoRig, float], StereoRig] | None
    below: str = ""

    def named(self, amount: float, std: float) -> str:
        """The text of an amount."""
        text = self.below if self.below and amount < 0 else self.text
        return text.format(self.amount.text(amount), f"{self.amount.unit * std:.1g}")


RADIANS, PIXELS, RELATIVE = Amount(57.3, 1e-3, 0.1), Amount(1, 1.0, 500.0), Amount(100, 1e-3, 0.3)
MOVED = "a camera has moved since; calibrate again"
OTHER = "give images of the calibrated mode, or calibrate again, and compare a known length"
ALONG, ACROSS, AXIS = range(3)
"""Directions in the image plane, of the baseline and across it; and that of the view."""


def _direction(rig: StereoRig, direction: int) -> int:
    """The camera's axis of that direction: the baseline may lie along x or y."""
    turned = direction != AXIS and upright_rotations(rig.T_right_left)[2] % 2
    return 1 - direction if turned else direction


def _turned(about: int) -> Callable[[StereoRig, float], StereoRig]:
    def make(rig: StereoRig, angle_rad: float) -> StereoRig:
        R = cv2.Rodrigues(angle_rad * np.eye(3)[_direction(rig, about)])[0]
        return replace(rig, T_right_left=rigid_transform(R, np.zeros(3)) @ rig.T_right_left)

    return make


def _moved_center(along: int) -> Callable[[StereoRig, float], StereoRig]:
    def make(rig: StereoRig, shift_px: float) -> StereoRig:
        K = rig.right.K.copy()
        K[_direction(rig, along), 2] += shift_px
        return replace(rig, right=replace(rig.right, K=K))

    return make


def _of_sides(
    change: Callable[[Camera, float], Camera], *sides: str
) -> Callable[[StereoRig, float], StereoRig]:
    """Make the rig with a change of the cameras of these sides, by an amount."""

    def make(rig: StereoRig, amount: float) -> StereoRig:
        left, right = (
            change(getattr(rig, side), amount) if side in sides else getattr(rig, side)
            for side in ("left", "right")
        )
        return replace(rig, left=left, right=right)

    return make


def _longer(camera: Camera, larger: float) -> Camera:
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= 1 + larger
    return replace(camera, K=K)


def _enlarged(camera: Camera, larger: float, *axes: int) -> Camera:
    """Enlarged about the middle of the image, along these axes (0: width), both where none is."""
    K, middle = camera.K.copy(), (np.array(camera.image_size) - 1) / 2
    for axis in axes or (0, 1):
        K[axis, axis] *= 1 + larger
        K[axis, 2] = middle[axis] + (1 + larger) * (K[axis, 2] - middle[axis])
    return replace(camera, K=K)


def _stretched(axis: int) -> Callable[[Camera, float], Camera]:
    return lambda camera, larger: _enlarged(camera, larger, axis)


def _bent(camera: Camera, more: float) -> Camera:
    size = max(camera.distortion.size, 4 if camera.model == "fisheye" else 5)
    distortion = np.pad(camera.distortion, (0, size - camera.distortion.size))
    distortion[0] += more
    return replace(camera, distortion=distortion)


def _bent_more(camera: Camera, more: float) -> Camera:
    return replace(camera, distortion=(1 + more) * camera.distortion)


def _in_water(rig: StereoRig, more: float) -> StereoRig:
    """A rig calibrated in air behind flat ports, in what has an index of 1 + more."""
    if rig.port is not None:
        return rig
    port = replace(flat_port(FLAT_PORT), water_index=1 + more)
    return replace(rig, medium="air", port=port)


LARGER = Amount(1, 1e-3, 1.5, zero=1)
"""Narrow modes of action cameras keep a half of each side."""
CUT_OUT = Cause(
    "images of both sides cropped and enlarged {} +- {} times, to the calibrated size",
    LARGER,
    "give images of the calibrated mode, or a calibration of this (or of the stabilized) one",
    _of_sides(_enlarged, "left", "right"),
    "images of both sides with a wider view, at {} +- {} of the calibrated scale",
)
STRETCHED = tuple(
    Cause(
        f"images of both sides stretched {{}} +- {{}} times in {of} (shapes, too)",
        LARGER,
        "give images as the camera took them (a converter, or 4:3 shown as 16:9, changes their "
        "shape), or a calibration of these images",
        _of_sides(_stretched(axis), "left", "right"),
        f"images of both sides squeezed to {{}} +- {{}} times their {of} (shapes, too)",
    )
    for axis, of in enumerate(("width", "height"))
)
"""Across the baseline they leave ranges right, and lengths wrong."""
OFF_CENTER = 0.05
"""Of the image's size: principal points of both sides so far from its center are rather those of
larger images.
"""


def _cut_out_of_larger(rig: StereoRig, part: float) -> StereoRig:
    """A rig whose images are cut out of the calibrated ones, so that the principal points lie in
    the middle by this part of what they are off.
    """
    sides = (rig.left, rig.right)
    off = np.mean([one.K[:2, 2] - (np.array(one.image_size) - 1) / 2 for one in sides], axis=0)
    if (np.abs(off) < OFF_CENTER * np.array(rig.left.image_size)).all():
        return rig

    def cut(camera: Camera) -> Camera:
        K = camera.K.copy()
        K[:2, 2] -= part * off
        return replace(camera, K=K)

    return replace(rig, left=cut(rig.left), right=cut(rig.right))


CROPPED = Cause(
    "images of both sides cropped from larger ones, which were calibrated (the center of the crop "
    "lies {} +- {} of the way to the principal points; 1: a crop of the middle)",
    Amount(1, 1e-2, 1.5, 0.5, zero=0),
    "give the whole images, or subtract the crop's left and upper edge from the principal points",
    _cut_out_of_larger,
)
IN_AIR = Cause(
    "light bent by a flat port (index {} +- {}), as with a calibration made in air",
    Amount(1, 1e-3, 0.42, 0.26, zero=1),  # water is 1.33 to 1.36
    "calibrate in water, or describe the port: " + DESCRIBE_PORT,
    _in_water,
)
LENSES = (
    *(
        Cause(f"another distortion of {of} (k1 by {{}} +- {{}})", Amount(1, 1e-3, 0.5), OTHER, make)
        for of, make in (
            ("both lenses", _of_sides(_bent, "left", "right")),
            ("the right lens", _of_sides(_bent, "right")),
            ("the left lens", _of_sides(_bent, "left")),
        )
    ),
    Cause(
        "a distortion of both lenses of {} +- {} times the calibrated one (0: images without "
        "distortion already; -1: coefficients of the other sign)",
        Amount(1, 1e-2, 2.5, 0.75, zero=1),  # less is rather another k1
        "give images as the camera took them, or a calibration of these images",
        _of_sides(_bent_more, "left", "right"),
    ),
)
CAUSES = (
    Cause(
        "a turn of a camera about the baseline (pitch) by {} +- {} degrees",
        RADIANS,
        MOVED,
        _turned(ALONG),
    ),
    Cause(
        "a turn of a camera toward or from the other one (yaw) by {} +- {} degrees",
        replace(RADIANS, most=0.05),
        MOVED,
        _turned(ACROSS),
    ),
    Cause("a roll of a camera by {} +- {} degrees", RADIANS, MOVED, _turned(AXIS)),
    Cause(
        "images shifted along the baseline by {} +- {} px (cropped, "
        "stabilized, another mode, a wrong principal point)",
        PIXELS,
        OTHER,
        _moved_center(ALONG),
    ),
    Cause(
        "images shifted across the baseline by {} +- {} px", PIXELS, MOVED, _moved_center(ACROSS)
    ),
    *(
        Cause(
            f"a focal length of {of} {{}} +- {{}} % longer{why}",
            RELATIVE,
            OTHER,
            _of_sides(_longer, *sides),
        )
        for of, why, sides in (
            ("the right side", "", ("right",)),
            ("the left side", "", ("left",)),
            ("both sides", " (by a third if one of air is used in water)", ("left", "right")),
        )
    ),
    CUT_OUT,
    CROPPED,
    *STRETCHED,
    *(
        Cause(
            f"images of the {side} side cropped and enlarged {{}} +- {{}} times",
            replace(LARGER, least=0.04),  # less is rather another focal length
            OTHER,
            _of_sides(_enlarged, side),
            f"images of the {side} side with a wider view, at {{}} +- {{}} of the calibrated scale",
        )
        for side in ("left", "right")
    ),
    IN_AIR,
    *LENSES,
    Cause(
        "disparities that grow over the rows, by {} +- {} px at the edge: rolling shutters that "
        "read rows in opposite directions, or at different moments",
        replace(PIXELS, most=50.0),
        "mount and trigger both cameras alike, or move slowly",
        None,
    ),
)
