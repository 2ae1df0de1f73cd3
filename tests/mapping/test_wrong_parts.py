"""A part of given poses that contradicts the pictures, while the rest of the track fits them."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.priors import turned_frames
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion
from stereo_seecolor.mapping.navigation.wrong_parts import wrong_parts
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.relative_pose import Edge

Poses = NDArray[np.float64]
FRAMES = 30
NOBODY = (np.zeros((0, 3), np.float32),) * FRAMES
NAMES = tuple(f"f{i:02}" for i in range(FRAMES))


def track() -> Poses:
    """Two bends, 0.8 m a frame."""
    along = 0.8 * np.arange(FRAMES)
    R = rotation_from_vector(np.stack([0 * along, 0 * along, 0.4 * np.sin(along / 3)], axis=1))
    places = np.stack([along, 2 * np.sin(along / 3), 0 * along], axis=1)
    return np.stack([rigid_transform(*one) for one in zip(R, places, strict=True)])


def parts(change: Callable[[Poses], None], turned: bool = False) -> list[str]:
    """What is said of the track after a change. turned: names run against time."""
    T, rng, edges = track(), np.random.default_rng(5), []
    for i, j in ((i, i + step) for step in (1, 2) for i in range(FRAMES - step)):
        measured = inverse(T[i]) @ T[j]
        measured[:3, 3] += rng.normal(0, 0.003, 3)
        edges.append(Edge(i, j, measured, np.eye(6), 100))
    change(T)
    times_s = np.arange(FRAMES)[:: -1 if turned else 1].astype(float)
    return wrong_parts(T, SeenMotion(edges), FrameIndex(NAMES, times_s, NOBODY))


def backwards(first: int, last: int) -> Callable[[Poses], None]:
    def change(T: Poses) -> None:
        T[first : last + 1] = T[first : last + 1][::-1].copy()

    return change


def noisy(std_m: float, first: int = 0, last: int = -1) -> Callable[[Poses], None]:
    def change(T: Poses) -> None:
        T[:, :3, 3] += np.random.default_rng(2).normal(0, std_m, (FRAMES, 3))
        backwards(first, last)(T)

    return change


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("first", "last"), [(4, 9), (12, 20), (20, 29)])
@pytest.mark.parametrize("std_m", [0.0, 0.02])
def test_poses_in_reverse_order_are_named(
    first: int, last: int, std_m: float, turned: bool
) -> None:
    (line,) = parts(noisy(std_m, first, last), turned)
    ends = (last, first) if turned else (first, last)
    assert f"from f{ends[0]:02} to f{ends[1]:02} contradict the images" in line
    assert "in reverse order they would fit" in line


def test_a_part_in_reverse_order_over_the_turn_between_two_lines_is_named() -> None:
    """Its middle frames, which are near to each other, hardly contradict the images."""
    along = [0.0, 0.5, 1, 1.5, 2, 2.5, 2.5, 2, 1.5, 1, 0.5, 0]
    places = np.stack([along, np.repeat([0.0, 0.4], 6), np.zeros(12)], axis=1)
    headings = np.repeat([[0, 0, 0], [0, 0, np.pi]], 6, axis=0)
    true = np.stack(
        [rigid_transform(R, t) for R, t in zip(rotation_from_vector(headings), places, strict=True)]
    )
    given = true.copy()
    given[3:9] = true[3:9][::-1]
    ends = [(i, i + 1) for i in range(11)] + [(i, i + 2) for i in (0, 1, 2, 3, 4, 6, 7, 8, 9)]
    ends += [(3, 6), (4, 7), (6, 9), (7, 10), (8, 11)]
    edges = [Edge(i, j, inverse(true[i]) @ true[j], np.eye(6), 100) for i, j in ends]
    index = FrameIndex(NAMES[:12], np.arange(12.0), NOBODY[:12])
    (line,) = wrong_parts(given, SeenMotion(edges), index)
    assert "from f03 to f08 contradict the images" in line
    assert "in reverse order they would fit" in line


def test_frames_of_which_others_want_another_attitude_are_found() -> None:
    """Most of a dive of two lines in reverse order looks like the dive, turned by half."""
    T = track()
    own = Placement(
        rigid_transform(rotation_from_vector(np.ones(3)), np.ones(3)) @ T, np.zeros(FRAMES, int)
    )
    given = Placement(T, np.zeros(FRAMES, int))
    assert not turned_frames(own, given).size
    half = rigid_transform(rotation_from_vector(np.array([0, 0, np.pi])), np.zeros(3))
    turned = np.concatenate([T[:10], half @ T[10:]])
    found = turned_frames(own, Placement(turned, np.zeros(FRAMES, int)))
    assert found.tolist() == list(range(10))


def test_poses_of_another_time_are_named_without_a_cause() -> None:
    def change(T: Poses) -> None:
        T[10:18] = T[np.random.default_rng(0).permutation(8) + 10]

    (line,) = parts(change)
    assert "neither the reverse order nor a sensor that stopped explains it" in line


def jump(T: Poses) -> None:
    T[15:, :3, 3] += [4.0, 0, 0]


def away_for_a_while(T: Poses) -> None:
    T[10:18, :3, 3] += [3.0, 1.0, 0]


def single_fix(T: Poses) -> None:
    T[11, :3, 3] += [5.0, 0, 0]


@pytest.mark.parametrize(
    "change", [noisy(0.0), noisy(0.5), jump, away_for_a_while, single_fix, backwards(0, 29)]
)
def test_noise_jumps_single_fixes_and_whole_tracks_are_not(change: Callable[[Poses], None]) -> None:
    assert parts(change) == []
