"""Rectification: turns of both cameras, the shared image plane, and images with aligned rows."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeVar, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import Array, RectifiedPair
from calibration.refraction import CameraInWater, cameras_in_water
from calibration.resizing import wrong_size
from calibration.rig import Camera, StereoRig, quarter_turn, quarter_turns_of, roll
from calibration.transforms import rigid_transform
from calibration.views import common_view, whole_view

DIAGONAL_DEG = 10.0
"""Turned by more than this, an image without empty corners would lose a third of a 4:3 view (1 /
1.216 of each side at 10 degrees), so the whole view is kept instead.
"""


@dataclass(frozen=True, eq=False)
class RectificationPlan:
    """Rectified axes and image planes of a rig.

    pair: upright geometry, as the left camera saw the scene. R_left, R_right: (3, 3) rotations from
    each camera's axes to the upright rectified axes. Matching takes both images turned so that the
    baseline is +x: matching_pair, R_left_matching and R_right_matching; the same for a rig whose
    right camera stands to the right.
    """

    pair: RectifiedPair
    R_left: Array
    R_right: Array

    @cached_property
    def matching_pair(self) -> RectifiedPair:
        """The geometry of the matched images: disparity runs along x, right of the left image."""
        return self.pair.turned(-self.pair.quarter_turns)

    @property
    def R_left_matching(self) -> Array:
        """The rotation (3, 3) from the left camera's axes to those of the matched left image."""
        return quarter_turn(self.pair.quarter_turns) @ self.R_left

    @property
    def R_right_matching(self) -> Array:
        """The rotation (3, 3) from the right camera's axes to those of the matched right image."""
        return quarter_turn(self.pair.quarter_turns) @ self.R_right

    @property
    def diagonal_deg(self) -> float:
        """The angle between baseline and nearest axis of the left image, -45..45 degrees."""
        return float(np.degrees(roll(self.R_left)))


@lru_cache(maxsize=16)
def plan_rectification(rig: StereoRig) -> RectificationPlan:
    """The rectified geometry of ``rig``. Raises CalibrationError for views that do not overlap.

    It is kept for the last rigs asked about: a rig equals itself alone, and does not change.
    """
    if rig.is_rectified:
        K = rig.left.K
        pair = RectifiedPair(
            K[0, 0], K[0, 2], rig.right.K[0, 2], K[1, 2], rig.baseline_m, rig.left.image_size
        )
        return RectificationPlan(pair, np.eye(3), np.eye(3))
    left, right, T_right_left = cameras_in_water(rig)
    R_left, R_right, turns = upright_rotations(T_right_left)
    if abs(np.degrees(roll(R_left))) > DIAGONAL_DEG:
        view = whole_view((left, R_left), (right, R_right), along=turns % 2)
    else:
        view = common_view([(left, R_left), (right, R_right)])
    baseline_m = float(np.linalg.norm(T_right_left[:3, 3]))
    pair = RectifiedPair(
        view.focal_px,
        view.cx_px,
        view.cx_px,
        view.cy_px,
        baseline_m,
        view.image_size,
        -turns % 4,
        rig.refinement.slope_std if rig.refinement else (0.0, 0.0),
    )
    return RectificationPlan(pair, R_left, R_right)


def rectified_slopes(camera: Camera | CameraInWater, R: Array, pixels: Array) -> Array:
    """Convert raw pixels (n, 2) of a camera to slopes x / z and y / z (n, 2) in rectified axes, to
    which R (3, 3) turns the camera's; NaN where a lens does not reach.
    """
    x, y, z = (camera.rays(pixels) @ R.T).T
    return np.column_stack([x / z, y / z])


def rectified_points(rig: StereoRig, left: Array, right: Array) -> tuple[Array, Array]:
    """Convert pixels (n, 2) of the raw left and right images to the images that are matched; NaN
    where a lens does not reach.
    """
    plan = plan_rectification(rig)
    pair = plan.matching_pair
    left_camera, right_camera, _ = cameras_in_water(rig)
    left_slopes = rectified_slopes(left_camera, plan.R_left_matching, left)
    right_slopes = rectified_slopes(right_camera, plan.R_right_matching, right)
    rectified = right_slopes * pair.focal_px + [pair.cx_left_px, pair.cy_px]
    if rig.is_rectified:
        rectified[:, 0] += pair.cx_right_px - pair.cx_left_px
    return left_slopes * pair.focal_px + [pair.cx_left_px, pair.cy_px], rectified


def raw_points(rig: StereoRig, left: Array, right: Array) -> tuple[Array, Array]:
    """The inverse of rectified_points: pixels (n, 2) in the raw left and right images."""
    plan = plan_rectification(rig)
    pair, raw = plan.matching_pair, []
    left_camera, right_camera, _ = cameras_in_water(rig)
    sides = (
        (left_camera, plan.R_left_matching, left, pair.cx_left_px),
        (right_camera, plan.R_right_matching, right, pair.cx_right_px),
    )
    for camera, R, pixels, cx_px in sides:
        slopes = (pixels - [cx_px, pair.cy_px]) / pair.focal_px
        raw.append(camera.project(np.column_stack([slopes, np.ones(len(slopes))]) @ R))
    return raw[0], raw[1]


QUARTER_TURNS = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}
"""OpenCV's codes of quarter turns counterclockwise."""


def upright_rotations(T_right_left: Array) -> tuple[Array, Array, int]:
    """Rotations (3, 3) from each camera's axes to upright rectified axes, and the quarter turn
    (0..3) that the baseline lies at.

    Upright: with the left camera turned by 45 degrees at most. 0: the right camera stands to the
    right (+x), 1: below (+y), 2: to the left, 3: above. A right camera mounted turned by a quarter
    is turned back first.
    """
    turned_right = quarter_turn(-quarter_turns_of(T_right_left[:3, :3]))
    R, translation = turned_right @ T_right_left[:3, :3], turned_right @ T_right_left[:3, 3]
    x, y, _ = -(_half(R).T @ translation)
    turns = round(np.arctan2(y, x) / (np.pi / 2)) % 4
    turn = quarter_turn(-turns)
    R_left, R_right = rectifying_rotations(rigid_transform(turn @ R @ turn.T, turn @ translation))
    return turn.T @ R_left @ turn, turn.T @ R_right @ turn @ turned_right, turns


def rectifying_rotations(T_right_left: Array) -> tuple[Array, Array]:
    """Compute the (3, 3) rotations from each camera's axes to common ones whose x axis is the
    baseline, each camera turned equally.

    Bouguet's construction, as in Learning OpenCV (Bradski and Kaehler 2008), ch. 12: halve the
    rotation between the cameras, then turn both so that the translation lies along x.
    """
    half = _half(T_right_left[:3, :3])
    turn = _rotation_onto_x(-(half.T @ T_right_left[:3, 3]))
    return turn @ half, turn @ half.T


def _half(R: Array) -> Array:
    half, _ = cv2.Rodrigues(cv2.Rodrigues(R)[0] / 2)
    return np.asarray(half, dtype=np.float64)


def _rotation_onto_x(vector: Array) -> Array:
    x = vector / np.linalg.norm(vector)
    axis = np.cross(x, [1.0, 0.0, 0.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-15:
        return np.eye(3)
    return np.asarray(cv2.Rodrigues(axis / sine * np.arctan2(sine, x[0]))[0], dtype=np.float64)


Image = NDArray[np.uint8] | NDArray[np.uint16]

Pixels = TypeVar("Pixels", bound=NDArray[Any])
RemapTables = tuple[NDArray[np.int16], NDArray[np.uint16]]


@dataclass(frozen=True, eq=False)
class Rectification:
    """The rectification of a rig's images; create one for a run.

    It has two geometries: for matching, images are rotated by multiples of 90 degrees so that the
    baseline is +x (``matching_pair``, ``apply_left``, ``apply_right``), and products are upright,
    as the left camera saw the scene (``pair``, ``upright``). Side by side both are the same.

    Attributes:
        pair: The upright geometry.
        R_left: (3, 3) rotation from the left camera's axes to the upright rectified axes.
        R_right: The same of the right camera.
        center_left_m: (3,) in the left camera's axes, meters: the center of the rectified left
            camera; off zero behind a flat port.
        raw_size: (width, height) of the left camera's images.
        raw_size_right: The same of the right camera.
        maps_left: cv2.remap tables (fixed point) to the image that is matched; None for a rig that
            is rectified already, whose images pass through untouched.
        maps_right: The same of the right camera.
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
        """Rectify a rig along its baseline.

        Images keep the size of the left camera's, and are as wide as both cameras see without empty
        corners; for a baseline more than 10 degrees off the image's axes they are larger and show
        the whole left view.

        Args:
            rig: The rig.

        Returns:
            Its rectification.

        Raises:
            CalibrationError: If the cameras share no field of view.
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
        """Rectify a raw left image for matching.

        Args:
            image: (H, W) or (H, W, C).

        Returns:
            The image, of the same dtype; black where the camera saw nothing.

        Raises:
            CalibrationError: If the image is of another size than the camera's.
        """
        return self._remap(image, self.maps_left, "left")

    def apply_right(self, image: Image) -> Image:
        """Rectify a raw right image for matching.

        Args:
            image: As in ``apply_left``.

        Returns:
            As in ``apply_left``.

        Raises:
            CalibrationError: As in ``apply_left``.
        """
        return self._remap(image, self.maps_right, "right")

    def upright(self, array: Pixels) -> Pixels:
        """Rotate an array from the matched left image's geometry to the upright one, ``pair``.

        Args:
            array: (H, W) or (H, W, C).

        Returns:
            The array itself if there is no rotation, else a contiguous copy.
        """
        if not self.pair.quarter_turns:
            return array
        # a quarter of the time of numpy's rot90, made contiguous; OpenCV knows no bool
        plain = array.view(np.uint8) if array.dtype == np.bool_ else array
        turned = cv2.rotate(plain, QUARTER_TURNS[self.pair.quarter_turns])
        return cast(Pixels, turned.view(array.dtype))

    @property
    def T_rectified_left(self) -> Array:
        """The transform of points from the left camera's axes, as calibrated, to the upright
        rectified left camera's: (4, 4).
        """
        return rigid_transform(self.R_left, -self.R_left @ self.center_left_m)

    def rectified_rig(self) -> StereoRig:
        """The rig of the upright rectified images.

        Returns:
            A rig without distortion and rotation, of one focal length.
        """
        turn = quarter_turn(-self.pair.quarter_turns)
        right_of_left = rigid_transform(np.eye(3), turn @ [-self.pair.baseline_m, 0.0, 0.0])
        K_right = self.pair.P_left.copy()
        K_right[0, 2] = self.pair.cx_right_px
        none, size = np.zeros(0), self.pair.image_size
        return StereoRig(
            Camera(self.pair.P_left, none, size), Camera(K_right, none, size), right_of_left
        )

    def seen_left(self) -> NDArray[np.bool_]:
        """Compute which pixels of the matched left image the left camera saw.

        Returns:
            (H, W) bool.
        """
        width, height = self.raw_size
        return np.asarray(self.apply_left(np.full((height, width), 255, np.uint8)) == 255)

    def _remap(self, image: Image, maps: RemapTables | None, side: str) -> Image:
        size = (image.shape[1], image.shape[0])
        calibrated = self.raw_size if side == "left" else self.raw_size_right
        if size != calibrated:
            raise CalibrationError(wrong_size(side, size, calibrated))
        if maps is None:
            return image
        rectified: Image = cv2.remap(
            image, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return rectified


def _maps(camera: Camera | CameraInWater, R: Array, pair: RectifiedPair) -> RemapTables:
    if isinstance(camera, CameraInWater) or camera.skew:
        return _maps_by_ray(camera, R, pair)
    build = (
        cv2.fisheye.initUndistortRectifyMap
        if camera.model == "fisheye"
        else cv2.initUndistortRectifyMap
    )
    table, fraction = build(
        camera.K, camera.distortion, R, pair.P_left, pair.image_size, cv2.CV_16SC2
    )
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
