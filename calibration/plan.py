"""The geometry of a rectification: how both cameras are turned, and what image plane they share."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.refraction import cameras_in_water
from calibration.rig import StereoRig
from calibration.turns import quarter_turn, quarter_turns_of, roll
from calibration.view_bounds import common_view, whole_view

Array = NDArray[np.float64]
DIAGONAL_DEG = 10.0
"""Turned by more than this, an image without empty corners would lose a third of a 4:3 view (1 / 1.216 of each side at 10
degrees), so the whole view is kept instead."""


@dataclass(frozen=True, eq=False)
class RectificationPlan:
    """Rectified axes and image planes of a rig.

    pair: upright geometry, as the left camera saw the scene. R_left, R_right: (3, 3) rotations from each camera's axes to the
    upright rectified axes. Matching takes both images turned so that the baseline is +x: matching_pair, R_left_matching and
    R_right_matching; the same for a rig whose right camera stands to the right.
    """

    pair: RectifiedPair
    R_left: Array
    R_right: Array

    @cached_property
    def matching_pair(self) -> RectifiedPair:
        """The geometry of the images that are matched: disparity runs along x, right of the left image."""
        return self.pair.turned(-self.pair.quarter_turns)

    @property
    def R_left_matching(self) -> Array:
        """The rotation from the left camera's axes to those of the left image that is matched: (3, 3)."""
        return quarter_turn(self.pair.quarter_turns) @ self.R_left

    @property
    def R_right_matching(self) -> Array:
        """The rotation from the right camera's axes to those of the right image that is matched: (3, 3)."""
        return quarter_turn(self.pair.quarter_turns) @ self.R_right

    @property
    def diagonal_deg(self) -> float:
        """The angle between the baseline and the nearest axis of the left image, degrees, -45..45."""
        return float(np.degrees(roll(self.R_left)))


def plan_rectification(rig: StereoRig) -> RectificationPlan:
    """The rectified geometry of ``rig``. Raises CalibrationError for views that do not overlap."""
    if rig.is_rectified:
        K = rig.left.K
        pair = RectifiedPair(K[0, 0], K[0, 2], rig.right.K[0, 2], K[1, 2], rig.baseline_m, rig.left.image_size)
        return RectificationPlan(pair, np.eye(3), np.eye(3))
    left, right, T_right_left = cameras_in_water(rig)
    R_left, R_right, turns = upright_rotations(T_right_left)
    if abs(np.degrees(roll(R_left))) > DIAGONAL_DEG:
        view = whole_view((left, R_left), (right, R_right), along=turns % 2)
    else:
        view = common_view([(left, R_left), (right, R_right)])
    baseline_m = float(np.linalg.norm(T_right_left[:3, 3]))
    pair = RectifiedPair(view.focal_px, view.cx_px, view.cx_px, view.cy_px, baseline_m, view.image_size, -turns % 4)
    return RectificationPlan(pair, R_left, R_right)


def rectified_points(rig: StereoRig, left: Array, right: Array) -> tuple[Array, Array]:
    """Convert pixels (n, 2) of the raw left and right images to the images that are matched; NaN where a lens does not reach."""
    plan = plan_rectification(rig)
    pair, rectified = plan.matching_pair, []
    left_camera, right_camera, _ = cameras_in_water(rig)
    for camera, R, pixels in ((left_camera, plan.R_left_matching, left), (right_camera, plan.R_right_matching, right)):
        x, y, z = (camera.rays(pixels) @ R.T).T
        rectified.append(np.column_stack([x / z * pair.focal_px + pair.cx_left_px, y / z * pair.focal_px + pair.cy_px]))
    if rig.is_rectified:
        rectified[1][:, 0] += pair.cx_right_px - pair.cx_left_px
    return rectified[0], rectified[1]


def raw_points(rig: StereoRig, left: Array, right: Array) -> tuple[Array, Array]:
    """The inverse of rectified_points: where pixels (n, 2) of the images that are matched lie in the raw left and right images."""
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


def upright_rotations(T_right_left: Array) -> tuple[Array, Array, int]:
    """Rotations (3, 3) from each camera's axes to upright rectified axes, and the quarter turn (0..3) that the baseline lies at.

    Upright: with the left camera turned by 45 degrees at most. 0: the right camera stands to the right (+x), 1: below (+y),
    2: to the left, 3: above. A right camera that is itself mounted turned by a quarter is turned back first.
    """
    turned_right = quarter_turn(-quarter_turns_of(T_right_left[:3, :3]))
    R, translation = turned_right @ T_right_left[:3, :3], turned_right @ T_right_left[:3, 3]
    x, y, _ = -(_half(R).T @ translation)
    turns = round(np.arctan2(y, x) / (np.pi / 2)) % 4
    turn = quarter_turn(-turns)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn @ R @ turn.T, turn @ translation
    R_left, R_right = rectifying_rotations(T)
    return turn.T @ R_left @ turn, turn.T @ R_right @ turn @ turned_right, turns


def rectifying_rotations(T_right_left: Array) -> tuple[Array, Array]:
    """Compute the (3, 3) rotations from each camera's axes to common ones whose x axis is the baseline, each camera turned equally.

    Bouguet's construction, as in Learning OpenCV (Bradski and Kaehler 2008), ch. 12: halve the rotation between the cameras,
    then turn both so that the translation lies along x.
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
