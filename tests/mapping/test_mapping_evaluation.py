"""The measures by which maps are judged, on cases with known answers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.map_errors import nearest_distance_m, surface_points, trajectory_error
from calibration.transforms import rigid_alignment, rotation_from_vector, transform_points


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 1000))
def test_nearest_agrees_with_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    queries, points = rng.uniform(-0.3, 0.3, (40, 3)), rng.uniform(-0.3, 0.3, (300, 3))
    brute = np.linalg.norm(queries[:, None] - points[None], axis=2).min(axis=1)
    np.testing.assert_allclose(
        nearest_distance_m(queries, points, 0.1), np.where(brute <= 0.1, brute, np.inf)
    )


def test_walls_of_a_height_field_are_filled_in() -> None:
    points = surface_points(np.array([[0.0, 0.1]]), (0, 0), 0.01)
    assert len(points) == 2 + 9
    np.testing.assert_allclose(points[:, 2].max() - points[:, 2].min(), 0.1)


def test_alignment_undoes_a_rigid_motion_but_keeps_scale() -> None:
    rng = np.random.default_rng(3)
    truth = np.cumsum(rng.normal(size=(50, 3)), axis=0)
    moved = truth @ rotation_from_vector(np.array([0.3, -2, 1])).T + [5, 6, 7]
    assert trajectory_error(moved, truth).rms_m < 1e-9
    assert trajectory_error(1.1 * moved, truth).rms_m > 0.05
    np.testing.assert_allclose(
        transform_points(rigid_alignment(moved, truth), moved), truth, atol=1e-9
    )


def test_many_alignments_at_once_are_those_of_each_and_none_mirrors() -> None:
    points = np.random.default_rng(4).normal(size=(3, 8, 3))
    targets = points * [1, 1, -1]
    T = rigid_alignment(points, targets)
    np.testing.assert_allclose(np.linalg.det(T[:, :3, :3]), 1)
    each = [rigid_alignment(*pair) for pair in zip(points, targets, strict=True)]
    np.testing.assert_allclose(T, each, atol=1e-12)


def test_path_is_the_length_of_the_true_track() -> None:
    truth = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    assert trajectory_error(truth, truth).path_m == 7
