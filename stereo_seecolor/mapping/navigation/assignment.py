"""Assignment of a trajectory's poses to frames; frames without a pose are named."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from calibration.transforms import interpolate
from stereo_seecolor.errors import MappingError
from stereo_seecolor.files.names import folder_keys, stem_of_path
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.survey_frames import Unplaced
from stereo_seecolor.mapping.track.jumps import break_up, drop_spikes
from stereo_seecolor.records import Trajectory

END_TOLERANCE_S = 0.01
"""A time stamp may lie so far outside of the poses: they are rounded in files."""

FARTHEST_POSE_S = 5.0
"""Poses are interpolated across gaps up to this long."""

CLOCK_S = 1e8
"""Times since 1970 are larger (1973); smaller ones count from the start of a dive."""


WITHIN_S = 60.0
"""Rows before and after a clock is set back lie so close."""
ALIKE = 0.2
"""Fraction by which a track from a start and a dive may differ in how long they last."""


@dataclass(frozen=True, eq=False)
class Assignment:
    """T_world_camera: (N, 4, 4), NaN without a pose. reasons: why, by frame. warnings: notes."""

    T_world_camera: NDArray[np.float64]
    reasons: dict[int, str]
    warnings: list[str]


def assign(index: FrameIndex, trajectory: Trajectory) -> Assignment:
    """Assign poses by name, or by folder and name (``10h_0001`` of ``10h/left/0001.png``); else by
    time, interpolated; else by order.

    By order where neither says anything; or by the numbers of frames of which only some are here.
    Raises MappingError.
    """
    by_stem = _places(trajectory.names, lambda name: [stem_of_path(name)])
    for by_key in (by_stem, _places(trajectory.names, folder_keys)):
        if by_key and by_key.keys() & {stem_of_path(name) for name in index.names}:
            return _by_name(index, trajectory, by_key)
    if np.isfinite(trajectory.timestamps_s).any() and np.isfinite(index.timestamps_s).any():
        by_number = _by_image_number(index, trajectory)
        return by_number or _by_time(index, trajectory)
    if not by_stem and len(trajectory.T_world_camera) == len(index.names):
        return _of_places(trajectory, np.arange(len(index.names)), "in order")
    if (
        not by_stem
        and (places := _numbers(index.names, len(trajectory.T_world_camera))) is not None
    ):
        first = f"{index.names[0]} has the pose of line {places[0] + 1}"
        return _of_places(
            trajectory, places, f"by the numbers in the frames' names, from 0 ({first})"
        )
    raise MappingError(
        f"the {len(trajectory.T_world_camera)} poses of the trajectory cannot be matched to the "
        f"{len(index.names)} frames: no common names (for example {trajectory.names[0]!r} and "
        f"{index.names[0]!r}), no common times, not the same number"
    )


def _places(names: Sequence[str], keys_of: Callable[[str], Sequence[str]]) -> dict[str, list[int]]:
    """Which of the names have a key, by the key. Where the clock is searched, a thousand times for
    poses without names: reading these as paths would take most of the time.
    """
    places: dict[str, list[int]] = {}
    if not any(names):
        return places
    for i, name in enumerate(names):
        for key in filter(None, keys_of(name)):
            places.setdefault(key, []).append(i)
    return places


def _numbers(names: Sequence[str], poses: int) -> NDArray[np.intp] | None:
    """The numbers that names end with, as KITTI numbers frames; None if one has none, or not all
    differ and have a pose.
    """
    found = [re.search(r"(\d{1,9})$", name) for name in names]
    numbers = np.array([int(number[1]) for number in found if number], np.intp)
    return numbers if len(set(numbers)) == len(names) and numbers.max() < poses else None


def _of_places(trajectory: Trajectory, places: NDArray[np.intp], how: str) -> Assignment:
    T = trajectory.T_world_camera[places]
    reasons = {int(i): "its pose is not known" for i in np.flatnonzero(~_finite(T))}
    T[list(reasons)] = np.nan
    return Assignment(
        T,
        reasons,
        [f"the trajectory has no frame names and no common times: poses were assigned {how}"],
    )


def _by_image_number(index: FrameIndex, trajectory: Trajectory) -> Assignment | None:
    """Poses whose times are numbers of images, as ground truth of some data sets has them; None
    where they may be times.

    Whole numbers from 0 or 1, at most one for each frame and for half of them at least, which do
    not last as long as the dive: seconds from a start do.
    """
    frames_s, numbers = index.timestamps_s, trajectory.timestamps_s
    if not (np.isfinite(numbers).all() and np.isfinite(frames_s).all()):
        return None
    if not from_start(frames_s, numbers) or (numbers % 1).any() or (np.diff(numbers) < 1).any():
        return None
    places = (numbers - (numbers[0] == 1)).astype(np.intp)
    lasts = (numbers[-1] - numbers[0]) / max(np.ptp(frames_s), 1e-9)
    fit = places[0] >= 0 and places[-1] < len(index.names) <= 2 * len(numbers)
    if not fit or abs(lasts - 1) < ALIKE:
        return None
    T = np.full((len(index.names), 4, 4), np.nan)
    T[index.order[places]] = trajectory.T_world_camera
    reasons = {
        int(i): "the trajectory has no pose of its number" for i in np.flatnonzero(~_finite(T))
    }
    return Assignment(
        T,
        reasons,
        [
            "the times of the trajectory are whole numbers and do not match the clock of the "
            f"frames: they were read as image numbers, from {int(numbers[0] == 1)} in order of time"
        ],
    )


def _by_name(index: FrameIndex, trajectory: Trajectory, by_key: dict[str, list[int]]) -> Assignment:
    T = np.full((len(index.names), 4, 4), np.nan)
    reasons: dict[int, str] = {}
    used: dict[int, str] = {}
    finite = _finite(trajectory.T_world_camera)
    for i, name in enumerate(index.names):
        poses = by_key.get(stem_of_path(name), [])
        if len(poses) > 1:  # two poses of one name: the one of the frame's time, if times tell
            gaps = np.abs(trajectory.timestamps_s[poses] - index.timestamps_s[i])
            poses = [poses[int(np.nanargmin(gaps))]] if np.isfinite(gaps).any() else poses
        if not poses:
            reasons[i] = "the trajectory does not contain its name"
        elif len(poses) > 1:
            reasons[i] = f"the trajectory contains its name {len(poses)} times"
        elif not finite[poses[0]]:
            reasons[i] = "its pose is not known"
        elif poses[0] in used:
            reasons[i] = "another pair of the same name has its pose"
        else:
            T[i] = trajectory.T_world_camera[poses[0]]
            used[poses[0]] = name
    return Assignment(T, reasons, [])


def from_start(frames_s: NDArray[np.float64], poses_s: NDArray[np.float64]) -> bool:
    """Whether one side's times are of a clock and the other's count from a start."""
    return bool(
        len(frames_s) and len(poses_s) and (frames_s.min() > CLOCK_S) != (poses_s.min() > CLOCK_S)
    )


def _clock_offset_s(frames_s: NDArray[np.float64], poses_s: NDArray[np.float64]) -> float | None:
    """What is to be added to the times of poses that count from a start: known where each frame has
    its pose, in one rhythm.
    """
    frames, poses = np.sort(frames_s), np.sort(poses_s)
    if len(frames) < 2 or len(frames) != len(poses) or not from_start(frames, poses):
        return None
    offsets = frames - poses
    return float(np.median(offsets)) if np.ptp(offsets) <= 2 * END_TOLERANCE_S else None


def _by_time(index: FrameIndex, trajectory: Trajectory) -> Assignment:
    warnings = []
    offset_s = _clock_offset_s(index.timestamps_s, trajectory.timestamps_s)
    if offset_s is not None:
        trajectory = replace(trajectory, timestamps_s=trajectory.timestamps_s + offset_s)
        warnings.append(
            "the times of the poses and of the frames have different origins, but equal number "
            f"and spacing: {offset_s:.3f} s were added to the times of the poses"
        )
    finite = _finite(trajectory.T_world_camera) & np.isfinite(trajectory.timestamps_s)
    if not finite.all():
        warnings.append(
            f"left out: {counted(int(np.count_nonzero(~finite)), 'pose of the trajectory')} whose "
            "position, attitude or time is not known"
        )
    times, first = np.unique(trajectory.timestamps_s[finite], return_index=True)
    poses = trajectory.T_world_camera[finite][first]
    if len(times) < np.count_nonzero(finite):
        repeated = counted(int(np.count_nonzero(finite)) - len(times), "pose")
        warnings.append(f"time stamps that repeat: {repeated} left out, the first of each kept")
    back_s = -np.diff(trajectory.timestamps_s[finite]).min(initial=0.0)
    if back_s > 0:
        warnings.append(
            f"the trajectory's poses are out of order (times go back by up to {back_s:.6g} s"
            f"{_set_back(back_s)}): they were sorted by time"
        )
    T = poses_at(times, poses, index.timestamps_s)
    reasons = {
        int(i): _why_without(times, float(index.timestamps_s[i]))
        for i in np.flatnonzero(~_finite(T))
    }
    return Assignment(T, reasons, warnings)


def _why_without(times: NDArray[np.float64], frame_s: float) -> str:
    """Why a frame has no pose. times: of the known poses, ascending."""
    if np.isnan(frame_s):
        return "it has no time stamp"
    if not len(times):
        return "no pose of the trajectory is known"
    for off_s, where in (
        (times[0] - frame_s, "before the first"),
        (frame_s - times[-1], "after the last"),
    ):
        if off_s > 0:
            return f"it was taken {round(off_s, 3):.15g} s {where} known pose of the trajectory"
    after = int(np.searchsorted(times, frame_s))
    return (
        f"the known poses around it are {times[after] - times[after - 1]:.6g} s apart, more than "
        f"{FARTHEST_POSE_S:g} s"
    )


def _set_back(back_s: float) -> str:
    """What sets times back by so much: only where it is 12 hours or one, to a minute."""
    for hours, what in ((12, "12 hours without AM and PM"), (1, "summer time")):
        if abs(back_s - 3600 * hours) < WITHIN_S:
            return f", as of a clock of {what}: give times in UTC"
    return ""


def poses_at(
    times: NDArray[np.float64], poses: NDArray[np.float64], wanted_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate poses (N, 4, 4) at ascending times to other times (M,), with constant velocities;
    NaN in gaps of over FARTHEST_POSE_S, and before the first and after the last pose, farther from
    a pose than END_TOLERANCE_S.
    """
    T = np.full((len(wanted_s), 4, 4), np.nan)
    if not len(times):
        return T
    near = np.clip(wanted_s, times[0], times[-1])
    after = np.clip(np.searchsorted(times, near), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    exact = times[after] == near
    before[exact] = after[exact]
    for one in (before, after):  # beside a pose at the end of a gap
        ends = (times[after] - times[before] > FARTHEST_POSE_S) & (
            np.abs(times[one] - near) <= END_TOLERANCE_S
        )
        before[ends] = after[ends] = one[ends]
    gap_s = times[after] - times[before]
    near = np.clip(near, times[before], times[after])
    known = (np.abs(near - wanted_s) <= END_TOLERANCE_S) & (gap_s <= FARTHEST_POSE_S)
    if not known.any():
        return T
    after, before, near = after[known], before[known], near[known]
    part = (near - times[before]) / np.where(gap_s[known] > 0, gap_s[known], 1)
    T[known] = interpolate(poses[before], poses[after], part)
    return T


def _finite(T: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(T).all(axis=(1, 2)))


def place(index: FrameIndex, trajectory: Trajectory) -> Placement:
    """Match a trajectory to frames: by name, else by time (interpolated), else, where neither says
    anything, by order.

    Poses that are not finite, or that jump away and back, leave their frame out; a jump that stays
    breaks the track into components. Raises MappingError if nothing matches.
    """
    found = assign(index, trajectory)
    T, reasons, warnings = found.T_world_camera, found.reasons | index.lost, found.warnings
    T[list(index.lost)] = float("nan")
    for name, count in Counter(index.names).items():
        if count > 1:
            warnings.append(f"{count} pairs are called {name}")
    drop_spikes(T, index, reasons)
    components, breaks = break_up(T, index)
    if not (components >= 0).any():
        first = next(iter(reasons.values()), "")
        fix = (
            clock_difference(index, trajectory)
            or "compare the frames' names and times with the file's"
        )
        raise MappingError(f"no frame has a pose in the trajectory ({first}): {fix}")
    unplaced = tuple(Unplaced(index.names[i], reasons[i]) for i in sorted(reasons))
    return Placement(T, components, unplaced, tuple(warnings + breaks))


DAYS_H = 72.0
"""Larger differences of clocks are printed in days."""


def clock_difference(index: FrameIndex, trajectory: Trajectory) -> str:
    """How far the times of poses and frames lie apart, and what to do; "" if they overlap."""
    frames, poses = (
        times[np.isfinite(times)] for times in (index.timestamps_s, trajectory.timestamps_s)
    )
    if (
        not len(frames)
        or not len(poses)
        or (poses.min() <= frames.max() and frames.min() <= poses.max())
    ):
        return ""
    if from_start(frames, poses):
        later = (
            f"{frames.min() - poses.min():+.3f} s to the times of the file if its first pose "
            "is that of the first frame"
        )
        file, dive = (f"{times.min():.1f} to {times.max():.1f} s" for times in (poses, frames))
        return (
            f"the times of the file are {file}, those of the frames {dive}: one of them starts "
            f"at 0 with the dive: add {later}"
        )
    ahead_h = float(poses.min() - frames.min()) / 3600
    by = f"{abs(ahead_h):.3f} h" if abs(ahead_h) < DAYS_H else f"{abs(ahead_h) / 24:.3f} days"
    return (
        f"it begins {by} {'after' if ahead_h > 0 else 'before'} the first frame: if one clock "
        "showed local time, or was not set, shift the times of the file by this amount"
    )
