"""Places seen before are recognized by what frames look like, at a cost that grows with the dive
and not with its square.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.mapping.track import place_recognition
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.loops import SETTINGS as LOOPS
from stereo_seecolor.mapping.track.loops import by_overlap
from stereo_seecolor.mapping.track.place_recognition import SETTINGS, by_appearance

LINE_FRAMES, CELL_M, LANDMARKS = 40, 0.7, 20


class Lawnmower(Lazy[Features]):
    """Lines half a meter apart over random landmarks; each frame sees most of those within nine
    cells, with noise.
    """

    def __init__(self, frames: int, blank: tuple[int, ...] = ()) -> None:
        number = np.arange(frames)
        line, along = number // LINE_FRAMES, number % LINE_FRAMES
        x = np.where(line % 2 == 0, along, LINE_FRAMES - 1 - along)
        self.position_m = 0.5 * np.stack([x, line, np.zeros(frames)], axis=-1)
        self.blank, self.reads = blank, Counter[int]()

    def __len__(self) -> int:
        return len(self.position_m)

    def item(self, number: int) -> Features:
        self.reads[number] += 1
        if number in self.blank:
            return Features.none()
        rng = np.random.default_rng(number)
        column, row = np.floor(self.position_m[number, :2] / CELL_M).astype(int)
        seen = np.concatenate(
            [landmarks(column + j, row + i) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        )
        seen = seen[rng.random(len(seen)) < 0.8]
        descriptors = np.clip(seen + rng.normal(0, 10, seen.shape), 0, 255).astype(np.uint8)
        unknown = np.zeros((len(seen), 3))
        return Features(unknown, unknown, unknown[:, 2], descriptors)

    def apart_m(self, pairs: list[tuple[int, int]]) -> NDArray[np.float64]:
        first, second = np.array(pairs).T
        return np.linalg.norm(self.position_m[first] - self.position_m[second], axis=1)


def landmarks(column: int, row: int) -> NDArray[np.float64]:
    """Descriptors of a cell, with few large numbers, as SIFT's."""
    return np.minimum(
        np.random.default_rng((column + 100, row + 100)).exponential(30, (LANDMARKS, 128)), 255
    )


@pytest.mark.slow
def test_lines_that_lie_side_by_side_are_recognized() -> None:
    dive = Lawnmower(3 * LINE_FRAMES)
    pairs = by_appearance(dive, Threads(1))
    true = dive.apart_m(pairs) < 1.5
    assert true.mean() > 0.9
    assert len(np.unique(np.array(pairs)[true])) > 0.95 * len(dive)
    assert min(b - a for a, b in pairs) >= SETTINGS.min_apart


@pytest.mark.slow
def test_frames_that_show_nothing_look_like_none() -> None:
    blank = tuple(range(50, 60))
    pairs = by_appearance(Lawnmower(2 * LINE_FRAMES, blank), Threads(1))
    assert pairs
    assert not set(blank) & {rank for pair in pairs for rank in pair}
    assert by_appearance(Lawnmower(LINE_FRAMES, tuple(range(LINE_FRAMES))), Threads(1)) == []


@pytest.mark.slow
def test_workers_do_not_change_what_is_recognized() -> None:
    assert by_appearance(Lawnmower(2 * LINE_FRAMES), Threads(1)) == by_appearance(
        Lawnmower(2 * LINE_FRAMES), Threads(3)
    )


@pytest.mark.slow
def test_the_work_grows_with_the_frames_and_not_with_their_square(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    small = replace(place_recognition.SETTINGS, sample_frames=60, cell=40, cells=4)
    monkeypatch.setattr(place_recognition, "SETTINGS", small)
    footprint = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    for frames in (160, 480):
        dive = Lawnmower(frames)
        pairs = by_appearance(dive, Threads(1))
        assert dive.reads.total() <= frames + 2 * small.sample_frames
        assert len(pairs) <= small.look_alike * frames
        true = np.array(pairs)[dive.apart_m(pairs) < 1.5]
        assert len(np.unique(true)) > 0.9 * frames
        near = by_overlap(((i, dive.position_m[i] + footprint) for i in range(frames)), 3)
        assert len(near) <= LOOPS.neighbors * frames
        assert max(dive.apart_m(near)) < 2 * LOOPS.overlap * np.sqrt(3)
