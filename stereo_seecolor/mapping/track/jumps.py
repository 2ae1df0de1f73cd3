"""Single poses that jump away and back, and jumps that stay: there a track breaks into parts."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.frame_index import FrameIndex

MIN_JUMP_M = 2.0
"""Less is not a jump, whatever the speed: positions of vehicles are not better."""
MAX_SPEED_M_S, JUMP_SPEEDS = 3.0, 3.0
"""Speed, m/s, and multiple of the usual speed that a step must both exceed to be a jump."""
JUMP_STEPS = 10.0
"""Usual steps that a jump exceeds, where times do not tell the speed."""


def drop_spikes(T: NDArray[np.float64], index: FrameIndex, reasons: dict[int, str]) -> None:
    """Take out single poses that jump away and back."""
    placed, is_jump = _placed(T, index)
    for before, spike, after in zip(placed, placed[1:], placed[2:], strict=False):
        if is_jump(before, spike) and is_jump(spike, after) and not is_jump(before, after):
            reasons[spike] = f"its pose jumps {_distance_m(T, before, spike):.1f} m away and back"
            T[spike] = np.nan


def break_up(T: NDArray[np.float64], index: FrameIndex) -> tuple[NDArray[np.int64], list[str]]:
    """Number the segments between jumps; the one with most frames is component 0."""
    placed, is_jump = _placed(T, index)
    jumps = [k for k, step in enumerate(pairwise(placed), 1) if is_jump(*step)]
    warnings = [
        f"the poses jump {_distance_m(T, before, after):.1f} m between {index.names[before]} and "
        f"{index.names[after]}"
        for before, after in ((placed[k - 1], placed[k]) for k in jumps)
    ]
    components = np.full(len(T), -1)
    segments = np.split(np.array(placed, np.int64), jumps)
    for number, segment in enumerate(sorted(segments, key=len, reverse=True)):
        components[segment] = number
    return components, warnings


def _placed(
    T: NDArray[np.float64], index: FrameIndex
) -> tuple[list[int], Callable[[int, int], bool]]:
    """The frames with a pose, by time; and whether two lie too far apart, by the vehicle's speed
    and times, or usual step.
    """
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    steps = np.array([_distance_m(T, a, b) for a, b in pairwise(placed)])
    usual = max(MIN_JUMP_M, JUMP_STEPS * float(np.median(steps))) if len(steps) else MIN_JUMP_M
    elapsed = np.abs(np.diff(index.timestamps_s[placed]))
    speeds = steps[elapsed > 0] / elapsed[elapsed > 0]
    usual_m_s = float(np.median(speeds)) if len(speeds) else 0.0
    fastest_m_s = max(MAX_SPEED_M_S, JUMP_SPEEDS * usual_m_s)

    def is_jump(a: int, b: int) -> bool:
        """False where one has no pose any more."""
        apart_s = abs(float(index.timestamps_s[b] - index.timestamps_s[a]))
        limit_m = max(MIN_JUMP_M, fastest_m_s * apart_s) if np.isfinite(apart_s) else usual
        return _distance_m(T, a, b) > limit_m

    return placed, is_jump


def _distance_m(T: NDArray[np.float64], a: int, b: int) -> float:
    return float(np.linalg.norm(T[a, :3, 3] - T[b, :3, 3]))
