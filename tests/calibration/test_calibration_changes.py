"""Pairs of a dive that one rigid rig did not take: found by comparing the rows of their matches."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration import RectifiedPair
from calibration.verification.changes import PairRows, changes_of, enlarged_side, pair_rows
from calibration.verification.matches import Matches
from calibration.verification.rigid_motion import SeenTwice

GEOMETRY = RectifiedPair(600.0, 319.5, 319.5, 239.5, 0.1, (640, 480))


def rows(
    seed: int,
    offset_px: float = 0.0,
    roll_deg: float = 0.0,
    scale: float = 1.0,
    apart: float = 0.0,
    swapped: bool = False,
) -> PairRows | None:
    """A pair of a bottom 2 to 3 m away, whose right image is moved; apart: rows by disparity."""
    rng = np.random.default_rng(seed)
    left = rng.uniform([-300, -220], [300, 220], (400, 2))
    disparity = 600 * 0.1 / rng.uniform(2, 3, 400) * (-1 if swapped else 1)
    right = left - np.column_stack([disparity, np.zeros(400)])
    turned = scale * right @ cv2.Rodrigues(np.radians([0, 0, roll_deg]))[0][:2, :2].T
    turned[:, 1] += offset_px + apart * (disparity - 25) + rng.normal(0, 0.06, 400)
    center = np.array([319.5, 239.5])
    return pair_rows(Matches(left + center, turned + center), GEOMETRY)


def test_pairs_of_a_rig_that_has_drifted_agree() -> None:
    assert changes_of([rows(i, 4.0, 0.3, 1.01) for i in range(8)]).kind == ""


@pytest.mark.parametrize("pairs", [8, 12])
def test_a_steady_change_is_a_drift_and_a_sudden_one_a_step(pairs: int) -> None:
    drift = changes_of([rows(i, 4.0 * i / (pairs - 1)) for i in range(pairs)])
    assert drift.kind == "drift"
    assert drift.spread_px == pytest.approx(4.0, abs=0.2)
    for first in (pairs // 4, pairs // 2, 3 * pairs // 4):
        step = changes_of([rows(i, 4.0 * (i >= first)) for i in range(pairs)])
        assert (step.kind, step.before, step.first) == ("step", first - 1, first)


def test_too_few_pairs_or_points_tell_nothing() -> None:
    assert changes_of([rows(0), rows(1), rows(2, 5.0)]).kind == ""
    few = Matches(np.zeros((20, 2)), np.zeros((20, 2)))
    assert pair_rows(few, GEOMETRY) is None
    assert changes_of([None, rows(0), None, rows(1)]).kind == ""


@pytest.mark.parametrize("scale", [0.97, 0.99, 1.012])
def test_the_pair_is_found_from_which_on_one_side_is_enlarged(scale: float) -> None:
    found = changes_of([rows(i, scale=scale if i >= 5 else 1.0) for i in range(9)])
    assert (found.kind, found.before, found.first) == ("step", 4, 5)
    assert found.scale == pytest.approx(scale, abs=0.0005)


def test_a_knocked_camera_is_no_enlargement() -> None:
    found = changes_of([rows(i, 2.0 * (i >= 3), 0.2 * (i >= 3)) for i in range(9)])
    assert (found.kind, found.first) == ("step", 3)
    assert np.isnan(found.scale)


def test_odd_pairs_are_found_among_others_that_agree() -> None:
    pairs = [rows(i) for i in range(12)]
    pairs[4] = rows(4, -9.0, 0.5, 1.02)
    assert changes_of(pairs).odd == (4,)
    pairs[9] = rows(9, swapped=True)
    assert changes_of(pairs).odd == (4, 9)
    pairs[1] = None
    assert changes_of(pairs).odd == (4, 9)


@pytest.mark.parametrize("size_px", [1.0, 4.0])
def test_images_that_move_from_frame_to_frame(size_px: float) -> None:
    move = np.random.default_rng(3).normal(0, size_px, 12)
    found = changes_of([rows(i, move[i], 0.1 * move[i]) for i in range(12)])
    assert found.kind == "each" and not found.moments and np.isnan(found.scale)
    assert 0.5 < found.spread_px / size_px < 2.0


def test_sides_of_two_moments_move_near_and_far_points_apart() -> None:
    move = np.random.default_rng(3).normal(0, 0.2, 12)
    found = changes_of([rows(i, 25 * move[i], apart=move[i]) for i in range(12)])
    assert found.kind == "each" and found.moments


def test_small_differences_of_a_lens_model_are_no_change() -> None:
    """As of a real survey: up to 0.3 px in offset and 0.2 px in scale."""
    move = np.random.default_rng(3).normal(0, 0.12, 12)
    assert changes_of([rows(i, move[i], scale=1 + move[i] / 700) for i in range(12)]).kind == ""


@pytest.mark.parametrize("side", ["left", "right"])
def test_motion_over_relief_tells_which_side_was_enlarged(side: str) -> None:
    rng, factor = np.random.default_rng(5), 1.03
    depth_m = rng.uniform(1, 3, 400)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (400, 2)), np.ones(400)]) * depth_m[:, None]
    after = points @ cv2.Rodrigues(np.array([0.05, -0.03, 0.1]))[0].T + [0.3, -0.1, 0.1]
    seen = []
    for x, y, z in (points.T, after.T):
        true = np.column_stack([x / z, y / z, GEOMETRY.baseline_m / z]) * GEOMETRY.focal_px
        seen.append(true + rng.normal(0, 0.1, true.shape))
    x, y, disparity = seen[1].T
    left, right = (factor, 1.0) if side == "left" else (1.0, factor)
    changed = np.column_stack([left * x, left * y, left * x - right * (x - disparity)])
    couple = SeenTwice(seen[0], changed)
    assert enlarged_side([couple], GEOMETRY, right / left) == side
    few = replace(couple, first=couple.first[:3], second=couple.second[:3])
    assert enlarged_side([few], GEOMETRY, right / left) == ""
    assert enlarged_side([], GEOMETRY, right / left) == ""


def test_few_points_in_one_corner_do_not_make_an_odd_pair() -> None:
    """Of a dark frame, say: the roll and the scale of the whole image are not known from them."""
    rng, pairs = np.random.default_rng(1), [rows(i) for i in range(11)]
    for seed in range(20):
        left = np.random.default_rng(seed).uniform([20, 20], [90, 70], (60, 2))
        right = left - [25, 0] + rng.normal(0, 0.25, (60, 2))
        assert changes_of([*pairs, pair_rows(Matches(left, right), GEOMETRY)]).kind == ""
