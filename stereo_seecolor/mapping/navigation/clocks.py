"""Poses as they would be with another clock: their times shifted, or with a clock that drifts."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import assign
from stereo_seecolor.records import Array, Trajectory

STEPS = 64
"""Times between frames that clocks may differ by,"""
PARTS = 4
"""and the parts of one that a difference is found to."""
HOURS = 14
"""Time zones reach so far."""
LEAST_POSED = 0.5
"""Of the frames must have a pose by a clock that is tried."""
MOST_DRIFT = 0.12
"""Of the dive: a video of 25 frames a second that is read as one of 24 is off by 0.04."""
DRIFTS = 0.6
"""Of the misfit that one difference leaves, a drift must leave less."""


def of_other_clocks(
    index: FrameIndex,
    trajectory: Trajectory,
    misfit: Callable[[Array], float],
) -> Iterator[tuple[str, Array]]:
    """The poses by the clock that fits best, and by a drifting one if that fits far better."""
    times_s = np.sort(index.timestamps_s[np.isfinite(index.timestamps_s)])
    if len(times_s) < 2 or times_s[0] == times_s[-1]:
        return
    step_s = float(np.median(np.diff(times_s)))
    if not step_s:
        return
    known = trajectory.T_world_camera[np.isfinite(trajectory.T_world_camera).all(axis=(1, 2))]
    if not len(known):
        return
    own = replace(trajectory, names=("",) * len(trajectory.names))
    about_s = times_s.mean()
    lasts_s = float(np.ptp(times_s))

    def poses(begin_s: float, end_s: float) -> Array:
        """Of clocks that differ by so much at the first and at the last frame."""
        differ_s = begin_s + (end_s - begin_s) * (own.timestamps_s - times_s[0]) / lasts_s
        moved = replace(own, timestamps_s=own.timestamps_s + differ_s)
        return assign(index, moved).T_world_camera

    @cache
    def cost(begin_s: float, end_s: float) -> float:
        T = poses(begin_s, end_s)
        posed = np.isfinite(T).all(axis=(1, 2))
        return misfit(T) if posed.mean() > LEAST_POSED else np.inf

    first_s, last_s = np.nanmin(own.timestamps_s), np.nanmax(own.timestamps_s)
    coarse = [n * step_s for n in range(-STEPS, STEPS + 1)]
    coarse += [3600.0 * n for n in range(-HOURS, HOURS + 1) if n]
    overlapping = [s for s in coarse if first_s < about_s - s < last_s]
    best_s = min(overlapping, key=lambda s: cost(s, s), default=0.0)
    fine = [best_s + n * step_s / PARTS for n in range(-PARTS, PARTS + 1)]
    best_s = min(fine, key=lambda s: (cost(s, s), abs(s)))
    if best_s:
        yield f"{best_s:+.2f} s added to the times of the poses", poses(best_s, best_s)
    begin_s = end_s = best_s
    for _ in range(2):
        near = [n * step_s / PARTS for n in range(-4 * PARTS, 4 * PARTS + 1)]
        end_s = min((end_s + s for s in near), key=lambda s: cost(begin_s, s))
        begin_s = min((begin_s + s for s in near), key=lambda s: cost(s, end_s))
    is_clock = abs(end_s - begin_s) < MOST_DRIFT * lasts_s
    if is_clock and cost(begin_s, end_s) < DRIFTS * cost(best_s, best_s):
        yield (
            f"{begin_s:+.2f} s added to the times of the poses at the first frame and "
            f"{end_s:+.2f} s at the last, as of a clock that drifts",
            poses(begin_s, end_s),
        )
