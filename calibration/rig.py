"""The stereo rig: two cameras, and the pose of the right one relative to the left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry import Array
from calibration.port import FlatPort, Port
from calibration.refinement import Refinement
from calibration.rig_errors import RigErrors

CameraModel = Literal["pinhole", "fisheye"]
Medium = Literal["water", "air"]

ORTHONORMAL_TOLERANCE = 1e-3  # of R R^T - 1: files with four digits pass, a wrong matrix does not
MAX_BASELINE_M = 2.0  # rigs of divers and vehicles are shorter: more is a mistake of unit
MIN_BASELINE_M = 0.005  # the same
MAX_IMAGE_SIDE_PX = 32767  # cv2.remap's limit
LEAST_FOCAL_PX = 10.0  # shorter ones are millimeters or parts of the width of the image
WIDEST_SLOPE = 20.0  # tan of 87 degrees
LEAST_STEP_PX = 1e-12  # rounding: with less, a ray takes all steps that it may
# how far a ray may come back from its pixel: beyond, the distortion folds over
RAY_TOLERANCE_PX = 0.01
SQUARE_TOLERANCE = 1e-5  # of fx / fy: 0.02 px at the border of an image of 4000 px
DISTORTION_LENGTHS = {"pinhole": (0, 4, 5, 8, 12, 14), "fisheye": (4,)}


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in OpenCV's model.

    Attributes:
        K: (3, 3) float64, pixels; the center of the top left pixel is (0, 0).
        distortion: (n,) float64 in OpenCV's order; n is 0, 4, 5, 8, 12 or 14 for pinhole, 4 for
            fisheye.
        image_size: (width, height), pixels.
        model: Lens model.

    Raises:
        CalibrationError: If a number is not finite, or a shape is wrong.
    """

    K: Array
    distortion: Array
    image_size: tuple[int, int]
    model: CameraModel = "pinhole"

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all():
            raise CalibrationError(
                f"camera matrix K must be 3x3 and finite, got shape {self.K.shape}: "
                f"{self.K.tolist()}"
            )
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise CalibrationError(
                f"focal lengths must be positive, got fx={self.K[0, 0]:g}, fy={self.K[1, 1]:g}"
            )
        if min(self.K[0, 0], self.K[1, 1]) < LEAST_FOCAL_PX:
            raise CalibrationError(
                f"focal lengths of {self.K[0, 0]:.4g} and {self.K[1, 1]:.4g} cannot be in pixels: "
                "if they are parts of the image's width and height, multiply both rows of K by "
                "these; if they are millimeters, divide by the size of a pixel"
            )
        if (
            self.K[0, 1] == 0
            and not self.K[:2, 2].any()
            and self.K[2, :2].all()
            and self.K[2, 2] == 1
        ):
            raise CalibrationError(
                "camera matrix K is transposed, as MATLAB's IntrinsicMatrix, its center in its "
                f"last row, {self.K[2].tolist()}: transpose it; for a MATLAB file also "
                "transpose the rotation and subtract 1 from both numbers of the center"
            )
        if not np.array_equal(self.K[2], [0, 0, 1]) or self.K[1, 0] != 0:
            raise CalibrationError(
                f"camera matrix K must be [fx s cx; 0 fy cy; 0 0 1], got {self.K.tolist()}"
            )
        if self.distortion.ndim != 1 or self.distortion.size not in DISTORTION_LENGTHS[self.model]:
            raise CalibrationError(
                f"{self.model} distortion takes {DISTORTION_LENGTHS[self.model]} coefficients, "
                f"got {self.distortion.size}"
            )
        if not np.isfinite(self.distortion).all():
            raise CalibrationError(
                f"distortion holds a number that is not finite: {self.distortion.tolist()}"
            )
        if min(self.image_size) < 1 or max(self.image_size) > MAX_IMAGE_SIDE_PX:
            raise CalibrationError(
                f"image_size must be (width, height) in pixels, 1 to {MAX_IMAGE_SIDE_PX}, got "
                f"{self.image_size}"
            )

    @property
    def skew(self) -> float:
        """K[0, 1], which OpenCV ignores."""
        return float(self.K[0, 1])

    def project(self, points: Array) -> Array:
        """Project points to pixels; only for points in front of the camera.

        Args:
            points: (n, 3) float64 in the axes of this camera.

        Returns:
            (n, 2) float64, pixels.
        """
        if len(points) == 0:
            return np.zeros((0, 2))  # OpenCV takes no empty arrays
        shaped, zero = points.reshape(-1, 1, 3), np.zeros(3)
        if self.model == "fisheye":
            pixels, _ = cv2.fisheye.projectPoints(shaped, zero, zero, self.K, self.distortion)
        else:
            pixels, _ = cv2.projectPoints(shaped, zero, zero, self.K, self.distortion)
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if self.skew:
            pixels[:, 0] += self._sheared_px(pixels)
        return pixels

    def rays(self, pixels: Array) -> Array:
        """Compute the directions of pixels.

        Args:
            pixels: (n, 2) float64.

        Returns:
            (n, 3) float64 with z = 1; NaN where the lens model does not reach the pixel, or the ray
            is perpendicular to the axis.
        """
        if len(pixels) == 0:
            return np.zeros((0, 3))
        shaped = pixels.reshape(-1, 1, 2)
        if self.skew:
            shaped = (
                shaped
                - np.stack([self._sheared_px(pixels), np.zeros(len(pixels))], axis=-1)[:, None]
            )
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, LEAST_STEP_PX)
        if self.model == "fisheye":
            slopes = cv2.fisheye.undistortPoints(shaped, self.K, self.distortion, criteria=criteria)
        else:
            slopes = cv2.undistortPoints(shaped, self.K, self.distortion, criteria=criteria)
        slopes = np.asarray(slopes, dtype=np.float64).reshape(-1, 2)
        slopes[~(np.abs(slopes).max(axis=1) < WIDEST_SLOPE)] = np.nan
        directions = np.column_stack([slopes, np.ones(len(slopes))])
        missed = ~(np.abs(self.project(directions) - pixels).max(axis=1) < RAY_TOLERANCE_PX)
        directions[missed] = np.nan
        return directions

    def _sheared_px(self, pixels: Array) -> Array:
        return np.asarray((pixels[:, 1] - self.K[1, 2]) * (self.skew / self.K[1, 1]))


@dataclass(frozen=True, eq=False)
class StereoRig:
    """Two cameras and the rigid transform between them.

    The right camera may be anywhere beside the left one (to the right, below, above, diagonally),
    rotated by any angle.

    Attributes:
        left: The left camera.
        right: The right camera.
        T_right_left: (4, 4) float64, meters: p_right = T_right_left @ p_left (R and T of OpenCV's
            stereoCalibrate).
        medium: Medium in which the calibration was made; air calibrations of cameras behind a flat
            port are wrong under water.
        rms_px: Reprojection error of the calibration, pixels; None if the file does not state it.
        port: The window of a rig calibrated in air; Rectification corrects for a flat window; None
            for all in-water calibrations.
        doubts: Assumptions that were needed to read the file, one line each.
        reading: The convention with which the file was read, if its format allows several.
        alternatives: The rig with the other conventions; ``resolve_convention`` decides with
            images.
        refinement: Changes that were estimated from a dive and are included in these numbers; None
            if there are none.
        errors: Standard errors of focal lengths and baseline; None if the file does not state them.

    Raises:
        CalibrationError: For a matrix that is not a rotation, and for a baseline that is zero,
            impossible, or along the optical axis.
    """

    left: Camera
    right: Camera
    T_right_left: Array
    medium: Medium = "water"
    rms_px: float | None = None
    port: Port | None = None
    doubts: tuple[str, ...] = ()
    reading: str = ""
    alternatives: "tuple[StereoRig, ...]" = ()
    refinement: Refinement | None = None
    errors: RigErrors | None = None

    def __post_init__(self) -> None:
        T = self.T_right_left
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise CalibrationError(f"T_right_left must be 4x4 and finite, got shape {T.shape}")
        if not np.array_equal(T[3], [0, 0, 0, 1]):
            raise CalibrationError(
                f"T_right_left: the last row must be 0 0 0 1, got {T[3].tolist()}"
            )
        _check_rotation(self.R)
        if isinstance(self.port, FlatPort) and self.medium != "air":
            raise CalibrationError(
                "port: a flat port is for cameras calibrated in air; a calibration made in water "
                "already includes the port: remove the port, or set medium: air"
            )
        _check_baseline(T[:3, 3], self.R)

    def with_alternatives(self, others: "Sequence[StereoRig]") -> "StereoRig":
        """This rig, with the alternatives that other conventions give for the same file.

        Args:
            others: The rigs with these conventions.

        Returns:
            The rig.
        """
        return replace(self, alternatives=tuple(others))

    @property
    def R(self) -> Array:
        """Rotation (3, 3) from left to right camera axes."""
        return self.T_right_left[:3, :3]

    @cached_property
    def baseline_m(self) -> float:
        """Distance between the two optical centers in meters."""
        return float(np.linalg.norm(self.T_right_left[:3, 3]))

    @property
    def is_rectified(self) -> bool:
        """Tell whether rows correspond already: no distortion, no rotation, square pixels, one
        focal length and cy, baseline along +x.

        The principal points cx may differ (Middlebury's doffs); Rectification applies them.
        """
        same_lens = np.allclose(
            self.left.K[[0, 1, 1], [0, 1, 2]], self.right.K[[0, 1, 1], [0, 1, 2]], atol=1e-6
        )
        square = (
            not self.left.skew
            and not self.right.skew
            and abs(self.left.K[0, 0] / self.left.K[1, 1] - 1) < SQUARE_TOLERANCE
        )
        no_distortion = not self.left.distortion.any() and not self.right.distortion.any()
        pinhole = self.left.model == self.right.model == "pinhole"
        return bool(
            pinhole
            and not isinstance(self.port, FlatPort)
            and self.left.image_size == self.right.image_size
            and same_lens
            and square
            and no_distortion
            and np.allclose(self.R, np.eye(3), atol=1e-9)
            and self.T_right_left[0, 3] < 0
            and np.allclose(self.T_right_left[1:3, 3], 0.0, atol=1e-9)
        )


COLOR_TAKEN = "color is taken"
GRAY_TAKEN = "the gray cameras are used, because the images are gray"
"""Readings of a file that holds a rig of color cameras, and as its alternative one of gray ones."""


def for_channels(rig: StereoRig, monochrome: bool) -> StereoRig:
    """Of a file with two rigs, the one of images in color, or in gray; others unchanged."""
    if rig.reading != COLOR_TAKEN or not rig.alternatives:
        return rig
    return rig.alternatives[0] if monochrome else replace(rig, alternatives=())


def _check_rotation(R: Array) -> None:
    error = float(np.abs(R @ R.T - np.eye(3)).max()) if np.abs(R).max() < 2 else np.inf
    if not error <= ORTHONORMAL_TOLERANCE or np.linalg.det(R) < 0:
        raise CalibrationError(
            f"T_right_left: R is not a rotation (R R^T differs from identity by {error:.3g}, det "
            f"{np.linalg.det(R):.3g}): copy R again from the calibration's output"
        )


def _unit_guess(baseline: float) -> str:
    if baseline < 20:
        return (
            f"centimeters it is {baseline / 100:g} m, in inches {baseline * 0.0254:g} m, and if it "
            "is in board squares, multiply by the size of a square"
        )
    return f"millimeters it is {baseline / 1000:g} m"


def _check_baseline(translation_m: Array, R: Array) -> None:
    baseline_m = float(np.linalg.norm(np.clip(translation_m, -1e9, 1e9)))
    if baseline_m < 1e-9:
        raise CalibrationError(
            "T_right_left: the baseline is zero: two single-camera calibrations contain no "
            "stereo geometry"
        )
    if baseline_m > MAX_BASELINE_M:
        raise CalibrationError(
            f"T_right_left: a baseline of {baseline_m:g} m is impossible: if the file is in "
            f"{_unit_guess(baseline_m)}; divide the translation, or calibrate again with the "
            "size of a square in meters"
        )
    if baseline_m < MIN_BASELINE_M:
        raise CalibrationError(
            f"T_right_left: a baseline of {baseline_m:g} m is impossible: the unit must be meters "
            "(OpenCV's stereo_calib sample writes board squares unless told their size)"
        )
    center_right_in_left = -R.T @ translation_m
    if abs(center_right_in_left[2]) > 2 * np.hypot(*center_right_in_left[:2]):
        raise CalibrationError(
            f"T_right_left: the second camera stands {center_right_in_left[2]:+.3f} m along the "
            "optical axis of the first, which is impossible for a stereo pair; check the "
            "order and the axes of the translation"
        )


_COSINES = (1.0, 0.0, -1.0, 0.0)


def quarter_turn(turns: int) -> Array:
    """The exact rotation about the optical axis by ``turns`` times 90 degrees, x towards y
    (clockwise in an image): (3, 3).
    """
    cosine, sine = _COSINES[turns % 4], _COSINES[(turns - 1) % 4]
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def quarter_turns_of(R: Array) -> int:
    """0..3: the quarter turn about the optical axis that the rotation (3, 3) is nearest to."""
    return round(roll(R) / (np.pi / 2)) % 4


def roll(R: Array) -> float:
    """The angle, radians, of the rotation about the optical axis nearest to one (3, 3)."""
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))
