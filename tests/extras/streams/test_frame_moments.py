"""Frames that a recorder lost or repeated, in videos without evidence of their clocks' offset."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.config import InputConfig
from stereo_seecolor.extras.streams.videos import choice
from stereo_seecolor.extras.streams.videos.frame_moments import frames_of_equal_moments
from stereo_seecolor.extras.streams.videos.motion import NoEvidence, VideoSignals

COUNT, RATE_HZ = 120, 25.0
NAMES = ("left.mp4", "right.mp4")
Edit = Callable[[list[int]], list[int]]


def video(
    moments: list[int], seed: int = 0, times: bool = False, sway: float = 0.0
) -> VideoSignals:
    """A side whose frames are of these moments (-1: black), while the cameras move steadily, with
    ``sway`` of that more or less. times: the file states when they were taken.
    """
    rng = np.random.default_rng(seed)
    at = np.maximum(np.array(moments), 0)
    times_s = (at if times else np.arange(len(at))) / RATE_HZ
    path = 0.006 * (at + sway * RATE_HZ / 4 * np.sin(at / RATE_HZ * 4))
    place = np.column_stack([path, 0.1 * path]) + rng.normal(0, 1e-4, (len(at), 2))
    brightness = np.where(np.array(moments) < 0, 0.0, 90.0)
    motion = np.diff(place, axis=0) / np.diff(times_s)[:, None]
    middle_s = (times_s[1:] + times_s[:-1]) / 2
    return VideoSignals(times_s, brightness, middle_s, motion, np.ones((len(at), 2)), 0.75)


def lost(count: int) -> Edit:
    return lambda moments: moments[:60] + moments[60 + count :]


def replaced(moments: list[int]) -> list[int]:
    return [moment - (moment % 7 == 3) for moment in moments]


def inserted(moments: list[int]) -> list[int]:
    return [moment for each in moments for moment in [each] * (1 + (each % 20 == 10))]


def black(moments: list[int]) -> list[int]:
    return [-1, -1, *moments]


@pytest.mark.parametrize("sway", [0.0, 0.2])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(
    ("edit", "note"),
    [
        (lost(1), "lacks frames by its motion, in 1 place, the first at 2.40 s"),
        (lost(7), "lacks frames by its motion, in 1 place, the first at 2.40 s"),
        (replaced, "repeats frames, in 17 places, the first at 0.12 s"),
        (inserted, "repeats frames, in 6 places, the first at 0.44 s"),
        (black, "begins with 2 frames of black"),
        (list, ""),
    ],
)
def test_frames_of_one_moment_are_paired(edit: Edit, note: str, side: int, sway: float) -> None:
    for seed in range(5):
        of_sides = [list(range(COUNT)), list(range(COUNT))]
        of_sides[side] = edit(of_sides[side])
        left, right = (video(m, 2 * seed + i, sway=sway) for i, m in enumerate(of_sides))
        found = frames_of_equal_moments(NAMES, (left, right))
        assert found.notes == ((f"{NAMES[side]} {note}",) if note else ())
        assert not found.is_wrong and len(found.pairs) > 0.8 * COUNT
        assert all(of_sides[0][a] == of_sides[1][b] for a, b in found.pairs)


def test_gaps_in_the_times_of_frames_are_lost_frames() -> None:
    taken = [moment for moment in range(COUNT) if moment % 9 != 4 and not 50 <= moment < 56]
    left, right = video(list(range(COUNT))), video(taken, times=True)
    found = frames_of_equal_moments(NAMES, (left, right))
    assert [taken[number] for number in found.pairs[:, 1]] == found.pairs[:, 0].tolist() == taken
    assert "right.mp4 lacks frames by the times of the others" in found.notes[0]


@pytest.mark.parametrize("edit", [lost(5), inserted, black])
def test_equal_lengths_contradict_frames_that_one_side_lost_or_has_more(edit: Edit) -> None:
    """As of recorders that end after so many frames."""
    of_right = edit(list(range(COUNT + 5)))[:COUNT]
    found = frames_of_equal_moments(NAMES, (video(list(range(COUNT))), video(of_right, 1)))
    assert found.is_wrong and "which frames are of one moment is not known" in found.notes[-1]


def test_lengths_that_do_not_tell_which_frames_were_lost_make_ranges_wrong() -> None:
    two_places = [*range(30), *range(31, 80), *range(82, COUNT)]
    found = frames_of_equal_moments(NAMES, (video(list(range(COUNT))), video(two_places, 1)))
    assert found.is_wrong
    assert "120 and 117 frames" in found.notes[-1]
    longer = frames_of_equal_moments(NAMES, (video(list(range(COUNT))), video(list(range(130)), 1)))
    assert not longer.is_wrong
    assert longer.notes == (
        "left.mp4 and right.mp4 hold 120 and 130 frames: did both begin at one moment?",
    )


def test_a_rate_that_varies_has_no_gaps() -> None:
    rng = np.random.default_rng(0)
    one = video(list(range(COUNT)))
    times_s = np.cumsum(rng.uniform(0.5, 1.9, COUNT)) / RATE_HZ
    varied = VideoSignals(times_s, *list(vars(one).values())[1:])
    found = frames_of_equal_moments(NAMES, (varied, varied))
    assert len(found.pairs) == COUNT and not found.notes


def test_videos_without_evidence_are_paired_by_moments(monkeypatch: pytest.MonkeyPatch) -> None:
    error = NoEvidence("no evidence")
    error.signals = video(list(range(COUNT))), video(lost(4)(list(range(COUNT))), 1)

    def synchronize(*_: object) -> None:
        raise error

    class File:
        class index:
            frame_s = 1 / RATE_HZ

            @staticmethod
            def numbers_at(times_s: np.ndarray) -> np.ndarray:
                return np.rint(times_s * RATE_HZ).astype(int)

    monkeypatch.setattr(choice, "synchronize", synchronize)
    monkeypatch.setattr(choice, "video_file", lambda _: File())
    found = choice.choose_frames(Path(NAMES[0]), Path(NAMES[1]), InputConfig())
    assert dict(zip(found.left, found.right, strict=True))[100] == 96
    assert found.notes[1].startswith("right.mp4 lacks frames") and not found.wrong
