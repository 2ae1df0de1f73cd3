"""Calibrations for images that were binned or resized since: the same rays in other pixels."""

from dataclasses import replace
from shlex import quote

import numpy as np

from calibration.errors import CalibrationError
from calibration.rig import Camera, StereoRig

Size = tuple[int, int]
ROUNDING_PX = 1.0
"""A side of a resized image may be off so far from the exact factor: binning drops a row."""


SAME_FACTOR = 0.15
"""The middles of both images, by their principal points, agree so far on another size: lenses are
mounted within 10 % of it.
"""
OTHER_SIZE = (0.67, 1.5)
"""Middles nearer to that of the image are those of a lens that is not mounted in the middle."""


def refuse_other_resolution(rig: StereoRig, where: str) -> None:
    """Raise CalibrationError if both cameras' principal points lie in the middle of images of one
    other size than the rig's.

    Files that store no image size give no other sign of it, and ranges would be off by the factor.
    """
    factors = np.array(
        [2 * camera.K[:2, 2] / camera.image_size for camera in (rig.left, rig.right)]
    )
    factor = float(factors.mean())
    if (
        np.abs(factors / factor - 1).max() < SAME_FACTOR
        and not OTHER_SIZE[0] < factor < OTHER_SIZE[1]
    ):
        images = rig.left.image_size
        made = tuple(round(2 * float(center)) for center in rig.left.K[:2, 2])
        raise CalibrationError(
            f"{where}: its principal points lie in the middle of images of about "
            f"{made[0]}x{made[1]} px, but these images have {_text(images)}: if they were "
            f"resized since, run: stereo-seecolor convert-calib {where} resized.yaml --size "
            f"WIDTHxHEIGHT --resize {_text(images)} with the size of the calibration images"
        )


def resize_factor(calibrated: Size, images: Size) -> float | None:
    """The size of the images over the calibration's; None if it differs along the sides."""
    factor = images[0] / calibrated[0]
    return (
        factor if abs(calibrated[1] * factor - images[1]) < ROUNDING_PX * max(1.0, factor) else None
    )


def wrong_size(side: str, images: Size, calibrated: Size, calib: str = "CALIB") -> str:
    """The error message for images of another size than the calibration's in ``calib``."""
    mismatch = (
        f"the {side} image is {_text(images)} px but the calibration is for {_text(calibrated)}"
    )
    factor = resize_factor(calibrated, images)
    if side == "right" and images != calibrated[::-1]:
        return f"{mismatch}, but the left image fits it: give images of the calibrated sizes"
    if factor is None:
        return f"{mismatch}, {_other_shape(images, calibrated)}"
    return (
        f"{mismatch}, {factor:.4g} times the size: if the whole images were binned or resized, "
        f"run: stereo-seecolor convert-calib {quote(calib)} resized.yaml --resize {_text(images)}; "
        "if they were cropped, use a calibration made at this resolution"
    )


def _other_shape(images: Size, calibrated: Size) -> str:
    """What images of another shape than the calibration's may be, and what to do."""
    if images == calibrated[::-1]:
        return (
            "rotated by 90 degrees: rotate them back (or remove their EXIF orientation, if the "
            "calibration was made without it)"
        )
    across, down = images[0] / calibrated[0], images[1] / calibrated[1]
    if across == 2 * down:
        return "as if both sides lay side by side in it: give it as --left and as --right"
    if down == 4 * across or (across, down) == (1, 2):
        return "as if both sides lay one above the other: give it as --left and as --right"
    if down == 2 * across:
        return (
            "half of its width, as if each side were squeezed: stretch both sides to the "
            "calibrated width; if what was given as --left and as --right shows one camera alone, "
            "give the other camera's as --right"
        )
    if down == 1 and across < 1:
        return (
            "a crop, another camera, or a video that stores its frames narrower than they are "
            "shown (sample aspect ratio): use a calibration made at this resolution, or export the "
            f"video with square pixels, {_text(calibrated)}"
        )
    return "a crop or another camera: use a calibration made at this resolution"


def resized_rig(rig: StereoRig, size: Size) -> StereoRig:
    """``rig`` for left images of ``size`` (width, height): the images of its calibration, resized
    but not cropped.

    Raises CalibrationError for a size of another shape.
    """
    factor = resize_factor(rig.left.image_size, size)
    if factor is None:
        raise CalibrationError(
            f"images of {_text(rig.left.image_size)} px cannot be resized to {_text(size)}: the "
            f"factors for width and height differ ({size[0] / rig.left.image_size[0]:.4g} and "
            f"{size[1] / rig.left.image_size[1]:.4g})"
        )
    right_size = size
    if rig.right.image_size != rig.left.image_size:
        right_size = (
            round(rig.right.image_size[0] * factor),
            round(rig.right.image_size[1] * factor),
        )
    left, right = _resized(rig.left, factor, size), _resized(rig.right, factor, right_size)
    return replace(
        rig,
        left=left,
        right=right,
        alternatives=tuple(resized_rig(other, size) for other in rig.alternatives),
    )


def _resized(camera: Camera, factor: float, size: Size) -> Camera:
    K = camera.K.copy()
    K[:2] *= factor
    K[:2, 2] += (factor - 1) / 2  # centers of pixels are at whole numbers
    return Camera(K, np.array(camera.distortion), size, camera.model)


def _text(size: Size) -> str:
    return f"{size[0]}x{size[1]}"
