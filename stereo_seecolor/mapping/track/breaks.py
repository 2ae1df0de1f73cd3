"""Single poses that jump away and back, and jumps that stay: there a track breaks into components."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.frame_index import FrameIndex

MIN_JUMP_M = 2.0
"""Less is no jump, whatever the speed: positions of vehicles are no better."""
JUMP_STEPS = 10.0
"""Usual steps between frames that a step must exceed to be a jump, where times do not tell the speed."""


def drop_spikes(T: NDArray[np.float64], index: FrameIndex, reasons: dict[int, str], config: MappingConfig) -> None:
    """Take out single poses that jump away and back."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed, config)
    for before, spike, after in zip(placed, placed[1:], placed[2:], strict=False):
        away = _distance_m(T, before, spike) > limit(before, spike) and _distance_m(T, spike, after) > limit(spike, after)
        if away and _distance_m(T, before, after) <= limit(before, after) and np.isfinite(T[before]).all():
            reasons[spike] = f"its pose jumps {_distance_m(T, before, spike):.1f} m away and back"
            T[spike] = np.nan


def break_up(T: NDArray[np.float64], index: FrameIndex, config: MappingConfig) -> tuple[NDArray[np.int64], list[str]]:
    """Number the stretches between jumps; the one with most frames is component 0."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed, config)
    stretches: list[list[int]] = []
    warnings = []
    for k, i in enumerate(placed):
        if k == 0 or _distance_m(T, placed[k - 1], i) > limit(placed[k - 1], i):
            if k:
                jump_m, before = _distance_m(T, placed[k - 1], i), index.names[placed[k - 1]]
                warnings.append(f"the poses jump {jump_m:.1f} m between {before} and {index.names[i]}")
            stretches.append([])
        stretches[-1].append(i)
    components = np.full(len(T), -1)
    for number, stretch in enumerate(sorted(stretches, key=len, reverse=True)):
        components[stretch] = number
    return components, warnings


def _step_limit_m(
    T: NDArray[np.float64], index: FrameIndex, placed: list[int], config: MappingConfig
) -> Callable[[int, int], float]:
    """How far two frames may lie apart: by the vehicle's speed where both have times, else by the usual step."""
    steps = [_distance_m(T, a, b) for a, b in pairwise(placed)]
    usual = max(MIN_JUMP_M, JUMP_STEPS * float(np.median(steps))) if steps else MIN_JUMP_M

    def limit(a: int, b: int) -> float:
        elapsed_s = index.timestamps_s[b] - index.timestamps_s[a]
        return max(MIN_JUMP_M, config.max_speed_m_s * abs(elapsed_s)) if np.isfinite(elapsed_s) else usual

    return limit


def _distance_m(T: NDArray[np.float64], a: int, b: int) -> float:
    return float(np.linalg.norm(T[a, :3, 3] - T[b, :3, 3]))
