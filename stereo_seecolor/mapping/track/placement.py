"""Placement of frames by a trajectory's poses; frames without a pose are named."""

from collections import Counter

import numpy as np

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.recovered_frames import Unplaced
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.assignment import assign, from_start
from stereo_seecolor.mapping.track.breaks import break_up, drop_spikes
from stereo_seecolor.records import Trajectory


def place(index: FrameIndex, trajectory: Trajectory, config: MappingConfig) -> Placement:
    """Match a trajectory to frames: by name, else by time (interpolated), else, where neither says anything, by order.

    Poses that are not finite, or that jump away and back, leave their frame out; a jump that stays breaks the track into
    components. Raises MappingError if nothing matches.
    """
    found = assign(index, trajectory, config)
    T, reasons, warnings = found.T_world_camera, found.reasons | index.lost, found.warnings
    T[list(index.lost)] = float("nan")
    for name, count in Counter(index.names).items():
        if count > 1:
            warnings.append(f"{count} pairs are called {name}")
    drop_spikes(T, index, reasons, config)
    components, breaks = break_up(T, index, config)
    if not (components >= 0).any():
        first = next(iter(reasons.values()), "")
        cure = clock_difference(index, trajectory) or "compare the frames' names and times with the file's"
        raise MappingError(f"no frame has a pose in the trajectory ({first}): {cure}")
    unplaced = tuple(Unplaced(index.names[i], reasons[i]) for i in sorted(reasons))
    return Placement(T, components, unplaced, tuple(warnings + breaks))


DAYS_H = 72.0
"""Differences of clocks are said in days from here on."""


def clock_difference(index: FrameIndex, trajectory: Trajectory) -> str:
    """How far the times of the poses lie from the frames', and what to do; "" where they overlap or are not known."""
    frames, poses = (times[np.isfinite(times)] for times in (index.timestamps_s, trajectory.timestamps_s))
    if not len(frames) or not len(poses) or (poses.min() <= frames.max() and frames.min() <= poses.max()):
        return ""
    if from_start(frames, poses):
        later = f"{frames.min() - poses.min():+.3f} s to the times of the file if its first pose is that of the first frame"
        file, dive = (f"{times.min():.1f} to {times.max():.1f} s" for times in (poses, frames))
        return f"the times of the file are {file}, those of the frames {dive}: one counts from the start of the dive: add {later}"
    ahead_h = float(poses.min() - frames.min()) / 3600
    by = f"{abs(ahead_h):.3f} h" if abs(ahead_h) < DAYS_H else f"{abs(ahead_h) / 24:.3f} days"
    return (
        f"it begins {by} {'after' if ahead_h > 0 else 'before'} the first frame: if one clock showed local time, "
        "or was not set, shift the times of the file by that"
    )
