"""Disparity, depth, range and points agree with each other and with hand calculation."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration import Camera, Rectification, RectifiedPair, StereoRig
from calibration.transforms import (
    rotation_from_euler,
    rotation_from_quaternion,
    rotation_from_vector,
)

PAIR = RectifiedPair(
    focal_px=500, cx_left_px=40, cx_right_px=30, cy_px=20, baseline_m=0.1, image_size=(80, 60)
)


@given(st.floats(0.2, 30))
def test_disparity_depth_round_trip(depth: float) -> None:
    depth_m = np.full((60, 80), depth, np.float32)
    np.testing.assert_allclose(
        PAIR.depth_from_disparity(PAIR.disparity_from_depth(depth_m)), depth_m, rtol=1e-4
    )
    np.testing.assert_allclose(
        PAIR.depth_from_range(PAIR.range_from_depth(depth_m)), depth_m, rtol=1e-6
    )


def test_differing_principal_points_are_honoured() -> None:
    disparity = np.full((60, 80), 35.0, np.float32)
    np.testing.assert_allclose(
        PAIR.depth_from_disparity(disparity), 500 * 0.1 / (35 - 10), rtol=1e-6
    )


def test_unknown_and_infinite_disparity_is_nan() -> None:
    disparity = np.array([[np.nan, 10.0, 5.0, 11.0]], np.float32)
    assert np.isnan(PAIR.depth_from_disparity(disparity)).tolist() == [[True, True, True, False]]


def test_range_is_length_of_point() -> None:
    range_m = np.full((60, 80), 2.0, np.float32)
    np.testing.assert_allclose(
        np.linalg.norm(PAIR.points_from_range(range_m), axis=2), 2.0, rtol=1e-6
    )


def test_rectified_rig_passes_images_through_untouched() -> None:
    K_left = np.array([[500.0, 0, 40], [0, 500, 20], [0, 0, 1]])
    K_right = np.array([[500.0, 0, 30], [0, 500, 20], [0, 0, 1]])
    T = np.eye(4)
    T[0, 3] = -0.1
    none = np.zeros(0)
    rectification = Rectification.from_rig(
        StereoRig(Camera(K_left, none, (80, 60)), Camera(K_right, none, (80, 60)), T)
    )
    image = np.zeros((60, 80, 3), np.uint16)
    assert rectification.apply_left(image) is image
    assert rectification.pair.cx_left_px - rectification.pair.cx_right_px == 10


def test_rotations_from_vectors_agree_with_scipy() -> None:
    vectors = (
        np.random.default_rng(3).normal(size=(50, 4, 3)) * np.array([0, 1e-9, 1e-3, 3])[:, None]
    )
    expected = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(50, 4, 3, 3)
    np.testing.assert_allclose(rotation_from_vector(vectors), expected, atol=1e-14)


def test_a_geometry_keeps_its_rays_at_a_smaller_size() -> None:
    pair = RectifiedPair(600.0, 320.2, 318.0, 251.7, 0.12, (643, 501))
    small = pair.reduced(2)
    assert small.image_size == (321, 250)
    # of the block of pixels (10..11, 20..21), which is pixel (5, 10) of the small image
    center = np.array([10.5, 20.5])
    rays = (center - (pair.cx_left_px, pair.cy_px)) / pair.focal_px
    np.testing.assert_allclose(
        (np.array([5, 10]) - (small.cx_left_px, small.cy_px)) / small.focal_px, rays
    )


def test_points_are_projected_to_the_pixels_that_show_them() -> None:
    points = PAIR.points_from_range(np.full((60, 80), 2.0, np.float32))
    y, x = np.mgrid[:60, :80]
    np.testing.assert_allclose(PAIR.project(points), np.stack([x, y], axis=-1), atol=1e-4)


def test_euler_angles_and_quaternions_make_the_rotations_that_scipy_makes() -> None:
    rng = np.random.default_rng(2)
    roll, pitch, yaw = rng.uniform(-np.pi, np.pi, (3, 4, 5))
    expected = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], -1).reshape(-1, 3))
    np.testing.assert_allclose(
        rotation_from_euler(roll, pitch, yaw).reshape(-1, 3, 3), expected.as_matrix(), atol=1e-15
    )
    assert rotation_from_euler(0.1, 0.2, 0.3).shape == (3, 3)
    xyzw = rng.normal(size=(50, 4)) * 10.0 ** rng.uniform(-200, 200, (50, 1))
    np.testing.assert_allclose(
        rotation_from_quaternion(xyzw),
        Rotation.from_quat(xyzw / np.abs(xyzw).max(axis=1, keepdims=True)).as_matrix(),
        atol=1e-15,
    )
    for unknown in ([0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 1]):
        assert np.isnan(rotation_from_quaternion(unknown)).all()
