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
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed)
    for before, spike, after in zip(placed, placed[1:], placed[2:], strict=False):
        away = _distance_m(T, before, spike) > limit(before, spike) and _distance_m(
            T, spike, after
        ) > limit(spike, after)
        if (
            away
            and _distance_m(T, before, after) <= limit(before, after)
            and np.isfinite(T[before]).all()
        ):
            reasons[spike] = f"its pose jumps {_distance_m(T, before, spike):.1f} m away and back"
            T[spike] = np.nan


def break_up(T: NDArray[np.float64], index: FrameIndex) -> tuple[NDArray[np.int64], list[str]]:
    """Number the segments between jumps; the one with most frames is component 0."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed)
    segments: list[list[int]] = []
    warnings = []
    for k, i in enumerate(placed):
        if k == 0 or _distance_m(T, placed[k - 1], i) > limit(placed[k - 1], i):
            if k:
                jump_m, before = _distance_m(T, placed[k - 1], i), index.names[placed[k - 1]]
                warnings.append(
                    f"the poses jump {jump_m:.1f} m between {before} and {index.names[i]}"
                )
            segments.append([])
        segments[-1].append(i)
    components = np.full(len(T), -1)
    for number, segment in enumerate(sorted(segments, key=len, reverse=True)):
        components[segment] = number
    return components, warnings


def _step_limit_m(
    T: NDArray[np.float64], index: FrameIndex, placed: list[int]
) -> Callable[[int, int], float]:
    """How far apart two frames may lie: by the vehicle's speed and times, or usual step."""
    steps = np.array([_distance_m(T, a, b) for a, b in pairwise(placed)])
    usual = max(MIN_JUMP_M, JUMP_STEPS * float(np.median(steps))) if len(steps) else MIN_JUMP_M
    elapsed = np.abs(np.diff(index.timestamps_s[placed]))
    speeds = steps[elapsed > 0] / elapsed[elapsed > 0]
    usual_m_s = float(np.median(speeds)) if len(speeds) else 0.0
    fastest_m_s = max(MAX_SPEED_M_S, JUMP_SPEEDS * usual_m_s)

    def limit(a: int, b: int) -> float:
        elapsed_s = index.timestamps_s[b] - index.timestamps_s[a]
        return max(MIN_JUMP_M, fastest_m_s * abs(elapsed_s)) if np.isfinite(elapsed_s) else usual

    return limit


def _distance_m(T: NDArray[np.float64], a: int, b: int) -> float:
    return float(np.linalg.norm(T[a, :3, 3] - T[b, :3, 3]))
