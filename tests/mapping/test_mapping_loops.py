"""Which frames that look alike can be a loop, by how far a track can have drifted."""

import numpy as np

from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.loops import possible

STEP_M = 0.5
OUT_AND_BACK = [*range(20), *range(19, -1, -1)]


def kept(
    places: list[int], pairs: list[tuple[int, int]], seen: bool = True, pieces: bool = False
) -> list[tuple[int, int]]:
    """Of pairs on a track along x; each frame sees a square of 2 m below it, or nothing. pieces:
    each frame is a component.
    """
    grid = np.linspace(-1, 1, 9, dtype=np.float32)
    points = np.stack([*np.meshgrid(grid, grid), np.full((9, 9), 2, np.float32)], -1).reshape(-1, 3)
    T = np.tile(np.eye(4), (len(places), 1, 1))
    T[:, 0, 3] = np.array(places) * STEP_M
    times_s, names = np.arange(len(places), dtype=float), tuple(str(i) for i in range(len(places)))
    index = FrameIndex(names, times_s, (points if seen else points[:0],) * len(places))
    return possible(
        pairs, index, T, np.arange(len(places)) if pieces else np.zeros(len(places), np.int64)
    )


def test_frames_are_compared_where_the_track_came_back_and_not_far_along_one_line() -> None:
    assert kept(OUT_AND_BACK, [(0, 10), (0, 19), (0, 39), (3, 5), (5, 36)]) == [
        (0, 39),
        (3, 5),
        (5, 36),
    ]


def test_after_a_long_way_the_track_may_have_drifted_off_frames_that_meet() -> None:
    """Ten times out and back, then 4 m past the start: a twentieth of nearly 200 m is more than
    what lies between them.
    """
    assert kept([*OUT_AND_BACK, -8], [(0, 40)]) == []
    assert kept([*OUT_AND_BACK * 10, -8], [(0, 400)]) == [(0, 400)]


def test_frames_that_cannot_be_told_apart_are_compared() -> None:
    assert kept([0, 10, 20], [(0, 2)], seen=False) == [(0, 2)]
    assert kept([0, 10, 20], [(0, 2)], pieces=True) == [(0, 2)]
