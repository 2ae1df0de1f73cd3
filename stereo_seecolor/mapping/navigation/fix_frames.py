"""Frames beside the fixes of a receiver that repeats each until the next one: what lies between two
fixes is interpolated, and says nothing of scales, clocks or single wrong positions.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import interpolate, inverse
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import poses_at
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.records import NEAR_FIX, Trajectory

LONG_STEP = 2.0
"""Median steps between frames: over longer ones it is not known how the camera moved."""


def fix_frames(
    given: Placement, own: Placement | None, index: FrameIndex, trajectory: Trajectory
) -> tuple[Placement, NDArray[np.bool_] | None]:
    """Move the frames nearest to fixes to where these place them, by what the camera moved from
    fix to frame. own: placed by the images alone.

    Returns the placement, and which frames (N,) these are; None where each row of the trajectory
    has its own position, or the images place nothing.
    """
    fixes_s, frames = trajectory.fixes_s, index.order[np.isfinite(index.timestamps_s[index.order])]
    if fixes_s is None or own is None or len(frames) < 2:
        return given, None
    times_s, gap_s = index.timestamps_s[frames], np.diff(fixes_s)
    near = np.searchsorted((times_s[1:] + times_s[:-1]) / 2, fixes_s)
    beyond = np.clip(near + np.where(fixes_s < times_s[near], -1, 1), 0, len(frames) - 1)
    off_s, step_s = fixes_s - times_s[near], times_s[beyond] - times_s[near]
    i, j = frames[near], frames[beyond]
    T, poses = given.T_world_camera.copy(), trajectory.T_world_camera
    rows = np.flatnonzero(
        np.isfinite(poses).all(axis=(1, 2)) & np.isfinite(trajectory.timestamps_s)
    )
    rows_s, first = np.unique(trajectory.timestamps_s[rows], return_index=True)
    fixes = poses_at(rows_s, poses[rows[first]], fixes_s)
    nearest_s = np.minimum(np.append(gap_s, np.inf), np.append(np.inf, gap_s))
    usable = (
        (np.abs(off_s) <= NEAR_FIX * nearest_s)
        & (np.abs(off_s) <= np.abs(step_s))
        & (np.abs(step_s) <= LONG_STEP * np.median(np.diff(times_s)))
        & (own.components[i] == own.components[j])
        & (own.components[i] >= 0)
        & np.isfinite(T[i]).all(axis=(1, 2))
        & np.isfinite(fixes).all(axis=(1, 2))
    )
    i, j, part = i[usable], j[usable], (off_s / np.where(step_s, step_s, 1))[usable]
    start = own.T_world_camera[i]
    moved_m = (inverse(start) @ interpolate(start, own.T_world_camera[j], part))[:, :3, 3]
    T[i, :3, 3] = fixes[usable, :3, 3] - np.einsum("nij,nj->ni", T[i, :3, :3], moved_m)
    fixed = np.zeros(len(T), np.bool_)
    fixed[i] = True
    return replace(given, T_world_camera=T), fixed
