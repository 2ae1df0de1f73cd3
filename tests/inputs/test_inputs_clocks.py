"""Two cameras whose clocks were never set to each other: files named by time stamps that differ by
a constant.
"""

from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.clock_offset import clock_offset_s
from stereo_seecolor.inputs.pairing import pair_folders

RNG = np.random.default_rng(1)


def dive(folder: Path, left_s: np.ndarray, right_s: np.ndarray) -> tuple[Path, Path]:
    for side, times in (("left", left_s), ("right", right_s)):
        (folder / side).mkdir()
        for time_s in times:
            (folder / side / f"{time_s:.3f}.png").touch()
    return folder / "left", folder / "right"


def test_pairs_are_found_by_a_constant_difference(tmp_path: Path) -> None:
    times = 1.3e9 + np.cumsum(RNG.uniform(0.3, 0.7, 12))
    left, right = dive(
        tmp_path, times[1:], np.delete(times, 5) + 37.21 + RNG.uniform(-0.003, 0.003, 11)
    )
    found = pair_folders(left, right, InputConfig())
    assert len(found.pairs) == 10
    assert len(found.unpaired) == 2
    apart = [float(pair.right.stem) - float(pair.left.stem) for pair in found.pairs]
    assert apart == pytest.approx([37.21] * 10, abs=0.006)
    assert found.notes[-1].startswith("the right clock is 37.2")
    assert "10 pairs of 11 left and 11 right images" in found.notes[-1]


@pytest.mark.parametrize("ahead_s", [3600.0, -5.02])
def test_a_steady_rhythm_is_taken_in_order(ahead_s: float) -> None:
    times = 1.3e9 + 0.5 * np.arange(30)
    assert clock_offset_s(times, times + ahead_s, 0.01) == pytest.approx(ahead_s, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_jitter_of_both_clocks_does_not_shift_a_rhythm_by_one(seed: int) -> None:
    """The difference of one pair alone, 8 ms off, fitted fewer pairs than one that was wrong by a
    frame.
    """
    rng = np.random.default_rng(seed)
    left_s, right_s = 1.3e9 + 0.5 * np.arange(7) + rng.uniform(-0.004, 0.004, (2, 7))
    assert clock_offset_s(left_s, right_s + 37.21, 0.01) == pytest.approx(37.21, abs=0.006)


def test_stamps_without_a_common_difference_are_refused(tmp_path: Path) -> None:
    left, right = dive(
        tmp_path, 1e9 + np.cumsum(RNG.uniform(0.3, 2, 9)), 1.1e9 + np.cumsum(RNG.uniform(0.3, 2, 9))
    )
    with pytest.raises(InputError, match="no left image matches a right one by name or time stamp"):
        pair_folders(left, right, InputConfig())
