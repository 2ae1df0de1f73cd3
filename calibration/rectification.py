"""Rectification: resample both images onto one image plane with aligned rows."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import RectifiedPair
from calibration.plan import plan_rectification
from calibration.refraction import CameraInWater, cameras_in_water
from calibration.resizing import wrong_size
from calibration.rig import Camera, StereoRig
from calibration.turns import quarter_turn

Image = NDArray[np.uint8] | NDArray[np.uint16]
Array = NDArray[np.float64]
Pixels = TypeVar("Pixels", bound=NDArray[Any])
RemapTables = tuple[NDArray[np.int16], NDArray[np.uint16]]


@dataclass(frozen=True, eq=False)
class Rectification:
    """The rectification of a rig's images; built once for a run.

    Two geometries: images are matched turned by quarter turns so that the baseline is +x (``matching_pair``, ``apply_left``,
    ``apply_right``), and products are upright, as the left camera saw the scene (``pair``, ``upright``). For a pair side by side
    both are the same.

    pair: the upright geometry. R_left, R_right: (3, 3) rotation from each camera's axes to the upright rectified axes.
    center_left_m: (3,) in the left camera's axes, where the rectified left camera has its center; off zero behind a flat port.
    raw_size, raw_size_right: (width, height) of the cameras' images.
    maps_left, maps_right: cv2.remap tables (fixed point) to the images that are matched, None for a rig that is rectified
    already: its images pass through untouched.
    """

    pair: RectifiedPair
    R_left: Array
    R_right: Array
    center_left_m: Array
    raw_size: tuple[int, int]
    raw_size_right: tuple[int, int]
    maps_left: RemapTables | None
    maps_right: RemapTables | None

    @classmethod
    def from_rig(cls, rig: StereoRig) -> "Rectification":
        """Rectify ``rig`` along its baseline: onto images of the left camera's size, as wide as both cameras see without empty
        corners; for a baseline more than 10 degrees off the image's axes onto larger ones that show the whole left view.

        Raises CalibrationError if the cameras share no field of view.
        """
        plan = plan_rectification(rig)
        sizes = rig.left.image_size, rig.right.image_size
        if rig.is_rectified:
            return cls(plan.pair, plan.R_left, plan.R_right, np.zeros(3), *sizes, None, None)
        left, right, _ = cameras_in_water(rig)
        center_m = left.center_m if isinstance(left, CameraInWater) else np.zeros(3)
        maps_left = _maps(left, plan.R_left_matching, plan.matching_pair)
        maps_right = _maps(right, plan.R_right_matching, plan.matching_pair)
        return cls(plan.pair, plan.R_left, plan.R_right, center_m, *sizes, maps_left, maps_right)

    @cached_property
    def matching_pair(self) -> RectifiedPair:
        """The geometry of the images that are matched: the baseline is +x."""
        return self.pair.turned(-self.pair.quarter_turns)

    def apply_left(self, image: Image) -> Image:
        """Rectify a raw left image (H, W) or (H, W, C) for matching; dtype kept, black where the camera saw nothing."""
        return self._remap(image, self.maps_left, "left")

    def apply_right(self, image: Image) -> Image:
        """Rectify a raw right image for matching; as apply_left."""
        return self._remap(image, self.maps_right, "right")

    def upright(self, array: Pixels) -> Pixels:
        """An image or map (H, W) or (H, W, C) that lies on the left image that is matched, turned upright: it lies on ``pair``.

        The array itself where nothing is turned, else a contiguous copy.
        """
        turns = self.pair.quarter_turns
        return cast(Pixels, np.ascontiguousarray(np.rot90(array, turns))) if turns else array

    @property
    def T_rectified_left(self) -> Array:
        """The transform of points from the left camera's axes, as calibrated, to the upright rectified left camera's: (4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R_left, -self.R_left @ self.center_left_m
        return T

    def rectified_rig(self) -> StereoRig:
        """The rig of the upright rectified images: no distortion, no rotation, one focal length."""
        right_of_left = np.eye(4)
        turn = quarter_turn(-self.pair.quarter_turns)
        right_of_left[:3, 3] = turn @ [-self.pair.baseline_m, 0.0, 0.0]
        K_right = self.pair.P_left.copy()
        K_right[0, 2] = self.pair.cx_right_px
        none, size = np.zeros(0), self.pair.image_size
        return StereoRig(Camera(self.pair.P_left, none, size), Camera(K_right, none, size), right_of_left)

    def seen_left(self) -> NDArray[np.bool_]:
        """Compute where the left image that is matched shows something that the left camera saw: (H, W) bool."""
        width, height = self.raw_size
        return np.asarray(self.apply_left(np.full((height, width), 255, np.uint8)) == 255)

    def _remap(self, image: Image, maps: RemapTables | None, side: str) -> Image:
        size, calibrated = (image.shape[1], image.shape[0]), self.raw_size if side == "left" else self.raw_size_right
        if size != calibrated:
            raise CalibrationError(wrong_size(side, size, calibrated))
        if maps is None:
            return image
        rectified: Image = cv2.remap(image, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return rectified


def _maps(camera: Camera | CameraInWater, R: Array, pair: RectifiedPair) -> RemapTables:
    if isinstance(camera, CameraInWater) or camera.skew:
        return _maps_by_ray(camera, R, pair)
    build = cv2.fisheye.initUndistortRectifyMap if camera.model == "fisheye" else cv2.initUndistortRectifyMap
    table, fraction = build(camera.K, camera.distortion, R, pair.P_left, pair.image_size, cv2.CV_16SC2)
    return table, fraction


def _maps_by_ray(camera: Camera | CameraInWater, R: Array, pair: RectifiedPair) -> RemapTables:
    """As _maps, for what OpenCV has no table for: water before a flat port, and skewed pixels."""
    width, height = pair.image_size
    where = np.empty((height, width, 2), dtype=np.float32)
    x = (np.arange(width) - pair.cx_left_px) / pair.focal_px
    for row in range(height):
        y = (row - pair.cy_px) / pair.focal_px
        directions = np.column_stack([x, np.full(width, y), np.ones(width)]) @ R
        where[row] = np.nan_to_num(camera.project(directions), nan=-1e4)
    table, fraction = cv2.convertMaps(where, None, cv2.CV_16SC2)
    return table, fraction
