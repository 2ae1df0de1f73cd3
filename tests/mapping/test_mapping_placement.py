"""Poses find their frames; what is damaged is named and left out, and nothing is joined that does
not belong together.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibration.transforms import interpolate, inverse, rotation_from_vector, rotation_vector
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.mapping.navigation.upright import upright
from stereo_seecolor.records import Trajectory

DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
BELOW = np.stack(
    [
        *(a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))),
        np.full(25, 2.0),
    ],
    -1,
)


def line(
    count: int = 10, step_m: float = 0.5, looking: NDArray[np.float64] = DOWN
) -> NDArray[np.float64]:
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = looking
    T[:, 0, 3] = np.arange(count) * step_m
    return T


def index(count: int = 10, names: tuple[str, ...] | None = None) -> FrameIndex:
    names = names or tuple(f"f{i:02d}" for i in range(count))
    return FrameIndex(names, np.arange(count, dtype=float), (BELOW.astype(np.float32),) * count)


def by_name(T: NDArray[np.float64], names: tuple[str, ...] | None = None) -> Trajectory:
    names = names or tuple(f"left/f{i:02d}.png" for i in range(len(T)))
    return Trajectory(names, np.full(len(T), np.nan), T)


def by_time(T: NDArray[np.float64], times: NDArray[np.float64] | None = None) -> Trajectory:
    return Trajectory(("",) * len(T), np.arange(len(T), dtype=float) if times is None else times, T)


def test_names_match_without_folder_and_suffix() -> None:
    placement = place(index(), by_name(line()))
    np.testing.assert_array_equal(placement.T_world_camera, line())
    assert placement.components.tolist() == [0] * 10
    assert not placement.unplaced


def test_time_between_two_poses_is_interpolated() -> None:
    trajectory = by_time(line(6, step_m=1.0), np.arange(6) * 2.0)
    placement = place(index(), trajectory)
    np.testing.assert_allclose(placement.T_world_camera[:, 0, 3], np.arange(10) * 0.5)


def test_poses_out_of_order_are_sorted_by_time() -> None:
    shuffle = np.random.default_rng(1).permutation(10)
    placement = place(index(), by_time(line()[shuffle], shuffle.astype(float)))
    np.testing.assert_allclose(placement.T_world_camera, line())
    assert "out of order" in placement.warnings[0]


@pytest.mark.parametrize(("hours", "clock"), [(12, "12 hours without AM and PM"), (1, "summer")])
def test_a_clock_that_goes_back_is_said(hours: int, clock: str) -> None:
    times_s = np.arange(10) - np.where(np.arange(10) < 5, 0, 3600.0 * hours)
    (warning, *_) = place(index(), by_time(line(), times_s)).warnings
    assert f"go back by up to {3600 * hours - 1} s, as of a clock of {clock}" in warning


def test_frames_out_of_order_are_no_jumps() -> None:
    shuffle = np.random.default_rng(2).permutation(40)
    ordered = index(40)
    shuffled = FrameIndex(
        tuple(ordered.names[i] for i in shuffle), ordered.timestamps_s[shuffle], ordered.points_m
    )
    # neighbors in the list lie up to 100 m apart
    placement = place(shuffled, by_name(line(40, step_m=2.5)))
    assert placement.components.tolist() == [0] * 40
    assert not placement.unplaced
    assert not placement.warnings


def test_names_match_by_folder_and_name_where_names_begin_anew() -> None:
    names = tuple(f"{hour}h_{i:04d}" for hour in (10, 11) for i in range(5))
    paths = tuple(f"DIVE\\{hour}h\\left\\{i:04d}.png" for hour in (10, 11) for i in range(5))
    np.testing.assert_allclose(
        place(index(names=names), by_name(line(), paths)).T_world_camera, line()
    )


@pytest.mark.parametrize("rounded_s", [[0.0] * 4, [0.0, -0.004, 0.004, 0.0]])
def test_a_gap_leaves_its_frames_out_and_names_them(rounded_s: list[float]) -> None:
    """Not those beside it, whose times or those of their poses are rounded."""
    keep = [0, 1, 8, 9]
    placement = place(index(), by_time(line()[keep], np.add(keep, rounded_s)))
    np.testing.assert_allclose(placement.T_world_camera[keep], line()[keep], atol=0.01)
    assert [u.name for u in placement.unplaced] == ["f02", "f03", "f04", "f05", "f06", "f07"]
    assert re.search("around it are 7(.008)? s apart, more than 5 s", placement.unplaced[0].reason)
    assert placement.components.tolist() == [0, 0, -1, -1, -1, -1, -1, -1, 0, 0]


def test_frames_before_and_after_all_poses_are_named_as_that() -> None:
    placement = place(index(), by_time(line()[2:8], np.arange(2.0, 8)))
    reasons = {frame.name: frame.reason for frame in placement.unplaced}
    assert reasons["f00"] == "it was taken 2 s before the first known pose of the trajectory"
    assert reasons["f09"] == "it was taken 2 s after the last known pose of the trajectory"


def test_a_jump_that_stays_breaks_the_map() -> None:
    T = line()
    T[6:, 1, 3] += 50
    placement = place(index(), by_name(T))
    assert placement.components.tolist() == [0] * 6 + [1] * 4
    assert "jump 50.0 m between f05 and f06" in placement.warnings[0]


def test_a_pose_that_jumps_away_and_back_is_left_out() -> None:
    T = line()
    T[4, 1, 3] += 50
    placement = place(index(), by_name(T))
    assert placement.components.tolist() == [0, 0, 0, 0, -1, 0, 0, 0, 0, 0]
    assert placement.unplaced[0].name == "f04"
    assert "jumps 50.0 m away and back" in placement.unplaced[0].reason


def test_a_pose_that_is_not_finite_leaves_its_frame_out() -> None:
    T = line()
    T[3, 0, 3] = np.nan
    assert place(index(), by_name(T)).unplaced[0].reason == "its pose is not known"
    placement = place(index(), by_time(T))
    assert not placement.unplaced  # its neighbors in time stand in for it
    assert "left out: 1 pose of the trajectory whose position" in placement.warnings[0]


def test_duplicate_time_stamps_count_once() -> None:
    T, times = line(11), np.array([0, 1, 1, 2, 3, 4, 5, 6, 7, 8, 9.0])
    T[3:, 0, 3] -= 0.5
    placement = place(index(), by_time(T, times))
    assert "time stamps that repeat: 1 pose left out" in placement.warnings[0]
    np.testing.assert_allclose(placement.T_world_camera[:, 0, 3], np.arange(10) * 0.5)


def test_two_pairs_of_one_name_are_told_apart_by_time_or_named() -> None:
    names = ("f00", "f01", "f01", *(f"f{i:02d}" for i in range(3, 10)))
    trajectory = by_name(line(), tuple(f"{n}.png" for n in names))
    placement = place(index(names=names), trajectory)
    assert "2 pairs are called f01" in placement.warnings[0]
    assert [u.name for u in placement.unplaced] == ["f01", "f01"]
    timed = Trajectory(trajectory.names, np.arange(10.0), trajectory.T_world_camera)
    np.testing.assert_allclose(place(index(names=names), timed).T_world_camera, line())


def test_poses_without_names_and_times_are_taken_in_order() -> None:
    nothing = np.full(10, np.nan)
    assert "assigned in order" in place(index(), by_time(line(), nothing)).warnings[0]
    with pytest.raises(
        MappingError, match="9 poses of the trajectory cannot be matched to the 10 frames"
    ):
        place(index(), by_time(line(9), nothing[:9]))


def test_some_frames_of_a_numbered_sequence_find_their_poses() -> None:
    nothing = np.full(30, np.nan)
    names = tuple(f"{i:06d}" for i in range(12, 22))
    placement = place(index(names=names), by_time(line(30), nothing))
    np.testing.assert_array_equal(placement.T_world_camera, line(30)[12:22])
    assert "000012 has the pose of line 13" in placement.warnings[0]


def test_a_trajectory_of_another_dive_is_refused() -> None:
    with pytest.raises(MappingError, match="no frame has a pose"):
        place(index(), by_time(line(), np.arange(10) + 1e6))
    with pytest.raises(
        MappingError,
        match=r"it begins 10\.000 h before the first frame: if one clock showed local time",
    ):
        place(index(), by_time(line(), np.arange(10) - 36000.0))


def test_times_that_count_from_the_start_of_the_dive() -> None:
    frames = replace(index(), timestamps_s=1.3e9 + np.arange(10) + 0.003 * np.arange(10) % 0.009)
    placement = place(frames, by_time(line(), np.arange(10.0)))
    np.testing.assert_array_equal(np.isfinite(placement.T_world_camera).all(axis=(1, 2)), True)
    assert "1300000000.00" in placement.warnings[0]
    with pytest.raises(
        MappingError, match=r"of the file are 0.0 to 4.5 s.* with the dive: add \+1300000000.000 s"
    ):
        place(frames, by_time(line(), np.arange(10) / 2))


def test_a_map_upside_down_is_refused() -> None:
    placement = place(index(), by_name(line(looking=np.eye(3))))
    with pytest.raises(MappingError, match=r"the bottom 2.0 m above the cameras"):
        upright(placement, index(), "z")


def test_a_world_that_does_not_know_up_is_leveled() -> None:
    tilt = np.eye(4)
    tilt[:3, :3] = rotation_from_vector(np.array([2.0, 0.7, -0.3]))
    placement = upright(place(index(), by_name(tilt @ line())), index(), "unknown")
    np.testing.assert_allclose(placement.T_world_camera[:, :3, 2] @ [0, 0, 1], -1, atol=1e-6)


@given(st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3), st.floats(0, 1))
def test_rotations_and_their_vectors_agree(vector: list[float], fraction: float) -> None:
    R = rotation_from_vector(np.array(vector))
    np.testing.assert_allclose(rotation_from_vector(rotation_vector(R)), R, atol=1e-5)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, vector
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-9)
    start, end, part = np.eye(4)[None], T[None], np.array([fraction])
    there = interpolate(start, end, part)[0]
    np.testing.assert_allclose(interpolate(end, start, 1 - part)[0, :3], there[:3], atol=1e-4)


@pytest.mark.parametrize("first", [0, 1])
def test_poses_by_number_of_image_find_their_frames(first: int) -> None:
    """As the ground truth of AQUALOC has them; one frame has no pose, and frames are .5 s apart."""
    frames = replace(index(), timestamps_s=1.79e9 + 0.5 * np.arange(10))
    known = np.delete(np.arange(10), 4)
    placement = place(frames, by_time(line()[known], known + float(first)))
    np.testing.assert_array_equal(placement.T_world_camera[known], line()[known])
    assert [frame.name for frame in placement.unplaced] == ["f04"]
    assert "read as image numbers" in " ".join(placement.warnings)


def test_whole_seconds_from_a_start_are_not_numbers_of_images() -> None:
    """Of a dive of 9 s: which pose belongs to which frame is not known."""
    frames = replace(index(20), timestamps_s=1.79e9 + np.linspace(0, 9, 20))
    with pytest.raises(MappingError):
        place(frames, by_time(line(), np.arange(10.0)))
