"""Rectification: bring both images onto one image plane, rows aligned."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import RectifiedPair
from calibration.rig import Camera, StereoRig

Image = NDArray[np.uint8] | NDArray[np.uint16]
RemapTables = tuple[NDArray[np.int16], NDArray[np.uint16]]


@dataclass(frozen=True, eq=False)
class Rectification:
    """How a rig's images become rectified ones; built once for a run.

    pair: the geometry after rectification.
    R_left, R_right: (3, 3) rotation from each camera's axes to the rectified axes.
    maps_left, maps_right: cv2.remap tables (fixed point), None for a rig that is rectified already: its images pass
    through untouched.
    """

    pair: RectifiedPair
    R_left: NDArray[np.float64]
    R_right: NDArray[np.float64]
    maps_left: RemapTables | None
    maps_right: RemapTables | None

    @classmethod
    def from_rig(cls, rig: StereoRig) -> "Rectification":
        """Rectify ``rig`` onto images of the left camera's size (OpenCV's stereoRectify, or its fisheye twin)."""
        if rig.left.image_size != rig.right.image_size:
            raise CalibrationError(f"left and right images differ in size: {rig.left.image_size} and {rig.right.image_size}")
        if rig.is_rectified:
            pair = _pair(rig.left.K, rig.right.K[0, 2], rig.baseline_m, rig.left.image_size)
            return cls(pair, np.eye(3), np.eye(3), None, None)
        R_left, R_right, P_left, P_right = _rectify(rig)
        pair = _pair(P_left[:, :3], P_right[0, 2], rig.baseline_m, rig.left.image_size)
        maps_left = _maps(rig.left, R_left, P_left)
        maps_right = _maps(rig.right, R_right, P_right)
        return cls(pair, R_left, R_right, maps_left, maps_right)

    def apply_left(self, image: Image) -> Image:
        """Rectify a left image (H, W) or (H, W, C); dtype kept, black where the camera saw nothing."""
        return _remap(image, self.maps_left, self.pair.image_size, "left")

    def apply_right(self, image: Image) -> Image:
        """Rectify a right image; as apply_left."""
        return _remap(image, self.maps_right, self.pair.image_size, "right")

    def rectified_rig(self) -> StereoRig:
        """The rig that the rectified images look taken by: no distortion, no rotation, one focal length."""
        right_of_left = np.eye(4)
        right_of_left[0, 3] = -self.pair.baseline_m
        K_right = self.pair.P_left.copy()
        K_right[0, 2] = self.pair.cx_right_px
        none, size = np.zeros(0), self.pair.image_size
        return StereoRig(Camera(self.pair.P_left, none, size), Camera(K_right, none, size), right_of_left)

    def seen_left(self) -> NDArray[np.bool_]:
        """(H, W) True where the rectified left image shows something that the left camera saw."""
        width, height = self.pair.image_size
        return np.asarray(self.apply_left(np.full((height, width), 255, np.uint8)) == 255)


def _pair(K_left: NDArray[np.float64], cx_right_px: float, baseline_m: float, image_size: tuple[int, int]) -> RectifiedPair:
    return RectifiedPair(
        focal_px=float(K_left[0, 0]),
        cx_left_px=float(K_left[0, 2]),
        cx_right_px=float(cx_right_px),
        cy_px=float(K_left[1, 2]),
        baseline_m=baseline_m,
        image_size=image_size,
    )


def _rectify(rig: StereoRig) -> tuple[NDArray[np.float64], ...]:
    if rig.left.model != rig.right.model:
        raise CalibrationError(f"cameras of two models: left is {rig.left.model}, right is {rig.right.model}")
    translation = rig.T_right_left[:3, 3:].copy()  # (3, 1): OpenCV 5 refuses a flat or a strided one
    lenses = (rig.left.K, rig.left.distortion, rig.right.K, rig.right.distortion, rig.left.image_size, rig.R, translation)
    if rig.left.model == "fisheye":
        matrices = cv2.fisheye.stereoRectify(*lenses, flags=cv2.CALIB_ZERO_DISPARITY, balance=0.0)[:4]
    else:
        matrices = cv2.stereoRectify(*lenses, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)[:4]
    R_left, R_right, P_left, P_right = (np.asarray(m, dtype=np.float64) for m in matrices)
    return R_left, R_right, P_left, P_right


def _maps(camera: Camera, R: NDArray[np.float64], P: NDArray[np.float64]) -> RemapTables:
    build = cv2.fisheye.initUndistortRectifyMap if camera.model == "fisheye" else cv2.initUndistortRectifyMap
    table, fraction = build(camera.K, camera.distortion, R, P, camera.image_size, cv2.CV_16SC2)
    return table, fraction


def _remap(image: Image, maps: RemapTables | None, image_size: tuple[int, int], side: str) -> Image:
    height, width = image.shape[:2]
    if (width, height) != image_size:
        raise CalibrationError(
            f"the {side} image is {width}x{height} px but the calibration is for {image_size[0]}x{image_size[1]}: "
            "use the calibration made at this resolution"
        )
    if maps is None:
        return image
    rectified: Image = cv2.remap(image, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return rectified
