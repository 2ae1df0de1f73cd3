"""Rigs of every placement: rows agree, ranges are right, and products are upright as the left
camera saw the scene.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from calibration_boards import pinhole_rig
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibration import Camera, Rectification, RectifiedPair, StereoRig
from calibration.rectification import plan_rectification, rectified_points
from calibration.rig import quarter_turn, quarter_turns_of
from calibration.suspicions import kept_fractions, suspicions

Array = NDArray[np.float64]
SIZE = (320, 240)
BASELINE_M = 0.1


def camera(fx: float = 250.0, fy: float = 250.0, skew: float = 0.0) -> Camera:
    K = np.array([[fx, skew, 163.0], [0, fy, 118.0], [0, 0, 1]])
    return Camera(K, np.array([-0.15, 0.04, 0.0005, -0.0003, 0.0]), SIZE)


def rig_at(
    angle_deg: float, right_turns: int = 0, tilt: tuple[float, float, float] = (0.01, -0.02, 0.015)
) -> StereoRig:
    """The right camera stands at this angle from +x towards +y, tilted a little, and itself turned
    by quarters.
    """
    angle = np.radians(angle_deg)
    center_m = BASELINE_M * np.array([np.cos(angle), np.sin(angle), 0.02])
    T = np.eye(4)
    T[:3, :3] = quarter_turn(right_turns) @ cv2.Rodrigues(np.array(tilt))[0]
    T[:3, 3] = -T[:3, :3] @ center_m
    return StereoRig(camera(), camera(252.0, 251.0), T)


def scene(rig: StereoRig, seed: int = 0) -> tuple[Array, Array, Array]:
    """Points (n, 3) that both cameras see, in left axes, and their raw pixels."""
    rng = np.random.default_rng(seed)
    points = rig.left.rays(rng.uniform([0, 0], np.array(SIZE) - 1, (500, 2))) * rng.uniform(
        0.7, 3, (500, 1)
    )
    right = rig.right.project(points @ rig.R.T + rig.T_right_left[:3, 3])
    inside = ((right > 0) & (right < np.array(SIZE) - 1)).all(axis=1)
    return points[inside], rig.left.project(points[inside]), right[inside]


def upright_pixels(rectification: Rectification, points: Array) -> Array:
    """Where the product geometry puts points (n, 3) of left axes."""
    T, pair = rectification.T_rectified_left, rectification.pair
    x, y, z = (points @ T[:3, :3].T + T[:3, 3]).T
    return np.column_stack(
        [x / z * pair.focal_px + pair.cx_left_px, y / z * pair.focal_px + pair.cy_px]
    )


@pytest.mark.slow
@settings(max_examples=60)
@given(
    quarter=st.integers(0, 3),
    off_deg=st.floats(-45, 45),
    right_turns=st.integers(0, 3),
    tilt=st.tuples(*[st.floats(-0.05, 0.05)] * 3),
)
def test_rows_agree_and_ranges_are_right(
    quarter: int, off_deg: float, right_turns: int, tilt: tuple[float, float, float]
) -> None:
    rig = rig_at(90 * quarter + off_deg, right_turns, tilt)
    points, raw_left, raw_right = scene(rig)
    left, right = rectified_points(rig, raw_left, raw_right)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=0.02)
    plan = plan_rectification(rig)
    disparity = left[:, 0] - right[:, 0]
    depth_m = plan.matching_pair.focal_px * rig.baseline_m / disparity
    np.testing.assert_allclose(depth_m, points @ plan.R_left_matching[2], rtol=2e-3)


@pytest.mark.parametrize("angle_deg", [0, 4, 90, 95, 180, 268, -90, 44, 30, 135, -120])
def test_products_are_upright_as_the_left_camera_saw_them(angle_deg: float) -> None:
    rig = rig_at(angle_deg)
    rectification = Rectification.from_rig(rig)
    points, raw_left, _ = scene(rig)
    pixels = upright_pixels(rectification, points)
    turn, _, _, _ = np.linalg.lstsq(
        raw_left - raw_left.mean(axis=0), pixels - pixels.mean(axis=0), rcond=None
    )
    nearest = round(angle_deg / 90) * 90
    assert np.degrees(np.arctan2(turn[1, 0] - turn[0, 1], np.trace(turn))) == pytest.approx(
        angle_deg - nearest, abs=2.0
    )
    width, height = rectification.pair.image_size
    assert (width, height) == SIZE or abs(angle_deg - nearest) > 10
    matching = rectification.apply_left(np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
    assert matching.shape[1::-1] == rectification.matching_pair.image_size
    assert rectification.upright(matching).shape == (height, width, 3)


@pytest.mark.slow
@pytest.mark.parametrize("angle_deg", [0, 3, 88, 180, -90, 40])
@pytest.mark.parametrize("skew", [0.0, 6.0])
def test_pictures_follow_the_geometry(angle_deg: float, skew: float) -> None:
    """A pattern that depends on the direction alone is found where the upright geometry and the
    matching geometry say.
    """
    rig = rig_at(angle_deg)
    rig = replace(rig, left=camera(250.0, 245.0, skew), right=camera(250.0, 245.0, skew))
    x, y = np.meshgrid(np.arange(SIZE[0], dtype=np.float64), np.arange(SIZE[1]))
    raw = _pattern(rig.left.rays(np.column_stack([x.ravel(), y.ravel()]))).reshape(SIZE[::-1])
    rectification = Rectification.from_rig(rig)
    matched = rectification.apply_left(raw.astype(np.uint8))
    seen = rectification.upright(
        cv2.erode(rectification.seen_left().astype(np.uint8), np.ones((5, 5))) > 0
    )
    wanted = _pattern(rectification.pair.rays.reshape(-1, 3) @ rectification.R_left).reshape(
        seen.shape
    )
    upright = rectification.upright(matched)
    assert seen.mean() > (0.35 if angle_deg == 40 else 0.9)
    np.testing.assert_allclose(upright[seen].astype(float), wanted[seen], atol=3)


def _pattern(directions: Array) -> Array:
    x, y = directions[:, 0] / directions[:, 2], directions[:, 1] / directions[:, 2]
    return np.asarray(120 + 60 * np.sin(9 * x + 1) + 50 * np.cos(7 * y + 4 * x))


def test_a_pair_side_by_side_is_not_turned() -> None:
    rectification = Rectification.from_rig(pinhole_rig())
    image = np.zeros((4, 5), np.uint8)
    assert rectification.upright(image) is image
    assert rectification.matching_pair.quarter_turns == rectification.pair.quarter_turns == 0
    assert rectification.maps_left is not None


@pytest.mark.parametrize("angle_deg", [0, 90, 180, 270, 91.5])
def test_rectified_rig_rectifies_to_itself(angle_deg: float) -> None:
    """The calibration written beside rectified images describes them: read back, they are matched
    as before.
    """
    rig = rig_at(angle_deg)
    first = Rectification.from_rig(rig)
    again = Rectification.from_rig(first.rectified_rig())
    assert again.pair.quarter_turns == first.pair.quarter_turns
    assert again.pair.baseline_m == pytest.approx(first.pair.baseline_m)
    np.testing.assert_allclose(again.pair.P_left, first.pair.P_left, atol=0.1)
    np.testing.assert_allclose(again.R_left, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("angle_deg", [30, 45, -50, 120])
def test_a_diagonal_rig_keeps_the_whole_view_and_says_so(angle_deg: float) -> None:
    rig = rig_at(angle_deg)
    assert kept_fractions(rig)[0] > 0.99
    assert "degrees off the axes of the image" in "; ".join(suspicions(rig))


def test_a_right_camera_to_the_left_is_suspicious() -> None:
    assert "to the LEFT" in "; ".join(suspicions(rig_at(180)))
    assert "to the LEFT" not in "; ".join(suspicions(rig_at(90)))


@pytest.mark.parametrize(("fx", "skew"), [(520.0, 0.0), (500.0, 4.0)])
def test_a_rectified_rig_of_pixels_that_are_not_square_is_resampled(fx: float, skew: float) -> None:
    """fx != fy taken as square gave 4 % in y."""
    K = np.array([[fx, skew, 160.0], [0, 500.0, 120], [0, 0, 1]])
    T = np.eye(4)
    T[0, 3] = -BASELINE_M
    rig = StereoRig(Camera(K, np.zeros(0), SIZE), Camera(K, np.zeros(0), SIZE), T)
    assert not rig.is_rectified
    point = np.array([[0.1, 0.15, 1.2]])
    left, right = rectified_points(
        rig, rig.left.project(point), rig.right.project(point + T[:3, 3])
    )
    pair = plan_rectification(rig).matching_pair
    assert left[0, 0] - right[0, 0] == pytest.approx(pair.focal_px * BASELINE_M / 1.2, rel=1e-5)
    np.testing.assert_allclose(left[0], pair.P_left[:2] @ (point[0] / 1.2), atol=1e-3)


@pytest.mark.slow
@given(turns=st.integers(-4, 7), roll_deg=st.floats(-44, 44))
def test_nearest_quarter_turn(turns: int, roll_deg: float) -> None:
    R = quarter_turn(turns) @ cv2.Rodrigues(np.array([0.05, 0.0, np.radians(roll_deg)]))[0]
    assert quarter_turns_of(R) == turns % 4


@pytest.mark.slow
@given(turns=st.integers(0, 7))
def test_turned_geometry_is_that_of_the_turned_image(turns: int) -> None:
    pair = plan_rectification(pinhole_rig()).pair
    turned = pair.turned(turns)
    np.testing.assert_allclose(turned.ray_length, np.rot90(pair.ray_length, turns), rtol=1e-6)
    assert turned.turned(-turns).quarter_turns == pair.quarter_turns
    assert turned.cx_left_px - turned.cx_right_px == pair.cx_left_px - pair.cx_right_px


@pytest.mark.slow
@given(turns=st.integers(0, 3), shift_px=st.floats(-20, 20))
def test_the_right_image_does_not_reach_what_projects_beside_it(
    turns: int, shift_px: float
) -> None:
    """A wall at 2 m, of which the right camera, 0.1 m beside, loses f b / z = 30 px at one side."""
    matched = RectifiedPair(600.0, 80.0, 80.0 - shift_px, 60.0, 0.1, (160, 120))
    pair = matched.turned(turns)
    range_m = 2 * pair.ray_length
    range_m[0, 0] = np.nan
    outside = np.rot90(pair.outside_right(range_m), -turns)
    right_x = np.arange(160) - (30 + shift_px)
    expected = np.tile((right_x < 0) | (right_x > 159), (120, 1))
    near_border = np.minimum(abs(right_x), abs(right_x - 159)) < 1e-3
    wrong = (outside != expected) & ~near_border
    assert np.count_nonzero(wrong) <= 1  # the pixel without a range
    assert not pair.outside_right(range_m)[0, 0]
