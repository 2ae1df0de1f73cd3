"""Assignment of a trajectory's poses to frames."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.files.names import folder_keys, stem_of_path
from stereo_seecolor.geometry import (
    interpolate,
    pose,
    rotation_from_vector,
    rotation_to_z,
    transformed,
)
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.kept_frames import Unplaced
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.components import break_up, drop_spikes
from stereo_seecolor.records import Trajectory
from stereo_seecolor.robust_statistics import TUKEY, biweight, deviation_about_zero

END_TOLERANCE_S = 0.01
"""So far before the first pose and after the last one a time stamp may lie: they are rounded in
files.
"""

FARTHEST_POSE_S = 5.0
"""Poses are interpolated across gaps up to this long."""

CLOCK_S = 1e8
"""Times since 1970 are larger (1973); smaller ones count from the start of a dive, a bag or a
program.
"""


@dataclass(frozen=True, eq=False)
class Assignment:
    """T_world_camera: (N, 4, 4), NaN where a frame has no pose. reasons: why, by frame. warnings:
    what a person should know.
    """

    T_world_camera: NDArray[np.float64]
    reasons: dict[int, str]
    warnings: list[str]


def assign(index: FrameIndex, trajectory: Trajectory, config: MappingConfig) -> Assignment:
    """Assign poses by name, or by folder and name (``10h_0001`` of ``10h/left/0001.png``); else by
    time, interpolated; else by order.

    By order where neither says anything; or by the numbers of frames of which only some are here.
    Raises MappingError.
    """
    by_stem = _places(trajectory.names, lambda name: [stem_of_path(name)])
    for by_key in (by_stem, _places(trajectory.names, folder_keys)):
        if by_key.keys() & {stem_of_path(name) for name in index.names}:
            return _by_name(index, trajectory, by_key)
    if np.isfinite(trajectory.timestamps_s).any() and np.isfinite(index.timestamps_s).any():
        return _by_time(index, trajectory, config)
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
    """Which of the names have a key, by the key."""
    places: dict[str, list[int]] = {}
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
    reasons = {int(i): "its pose is not finite" for i in np.flatnonzero(~_finite(T))}
    T[list(reasons)] = np.nan
    return Assignment(
        T,
        reasons,
        [f"the trajectory names no frames and holds no common time: poses were taken {how}"],
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
            reasons[i] = "the trajectory does not name it"
        elif len(poses) > 1:
            reasons[i] = f"the trajectory names it {len(poses)} times"
        elif not finite[poses[0]]:
            reasons[i] = "its pose is not finite"
        elif poses[0] in used:
            reasons[i] = "another pair of the same name has its pose"
        else:
            T[i] = trajectory.T_world_camera[poses[0]]
            used[poses[0]] = name
    return Assignment(T, reasons, [])


def from_start(frames_s: NDArray[np.float64], poses_s: NDArray[np.float64]) -> bool:
    """Tell whether the times of one side, finite, are of a clock and those of the other count from
    a start.
    """
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


def _by_time(index: FrameIndex, trajectory: Trajectory, config: MappingConfig) -> Assignment:
    warnings = []
    offset_s = _clock_offset_s(index.timestamps_s, trajectory.timestamps_s)
    if offset_s is not None:
        trajectory = replace(trajectory, timestamps_s=trajectory.timestamps_s + offset_s)
        warnings.append(
            "the times of the poses and of the frames have different origins; there are as "
            f"many, in the same rhythm: {offset_s:.3f} s were added to those of the poses"
        )
    finite = _finite(trajectory.T_world_camera) & np.isfinite(trajectory.timestamps_s)
    if not finite.all():
        warnings.append(
            f"left out: {counted(int(np.count_nonzero(~finite)), 'pose of the trajectory')}, not "
            "finite"
        )
    times, first = np.unique(trajectory.timestamps_s[finite], return_index=True)
    poses = trajectory.T_world_camera[finite][first]
    if len(times) < np.count_nonzero(finite):
        repeated = counted(int(np.count_nonzero(finite)) - len(times), "pose")
        warnings.append(f"time stamps that repeat: {repeated} left out, the first of each kept")
    if (np.diff(trajectory.timestamps_s[finite]) < 0).any():
        warnings.append("the trajectory's poses are out of order: they were sorted by time")
    T = np.full((len(index.names), 4, 4), np.nan)
    reasons: dict[int, str] = {}
    for i, time_s in enumerate(index.timestamps_s):
        pose = _at(times, poses, time_s, FARTHEST_POSE_S)
        if pose is None:
            reasons[i] = (
                "it has no time stamp"
                if np.isnan(time_s)
                else f"the trajectory has no pose within {FARTHEST_POSE_S:g} s"
            )
        else:
            T[i] = pose
    return Assignment(T, reasons, warnings)


def _at(
    times: NDArray[np.float64], poses: NDArray[np.float64], time_s: float, max_gap_s: float
) -> NDArray[np.float64] | None:
    if np.isnan(time_s) or not len(times):
        return None
    after = int(np.searchsorted(times, time_s))
    nearest = min(
        (i for i in (after - 1, after) if 0 <= i < len(times)), key=lambda i: abs(times[i] - time_s)
    )
    if abs(times[nearest] - time_s) <= END_TOLERANCE_S and (
        after in (0, len(times)) or times[nearest] == time_s
    ):
        return np.asarray(poses[nearest])
    if after in (0, len(times)) or times[after] - times[after - 1] > max_gap_s:
        return None
    fraction = (time_s - times[after - 1]) / (times[after] - times[after - 1])
    return interpolate(poses[after - 1], poses[after], float(fraction))


def _finite(T: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(T).all(axis=(1, 2)))


# Placement of frames by a trajectory's poses; frames without a pose are named.


def place(index: FrameIndex, trajectory: Trajectory, config: MappingConfig) -> Placement:
    """Match a trajectory to frames: by name, else by time (interpolated), else, where neither says
    anything, by order.

    Poses that are not finite, or that jump away and back, leave their frame out; a jump that stays
    breaks the track into components. Raises MappingError if nothing matches.
    """
    found = assign(index, trajectory, config)
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
"""Differences of clocks are said in days from here on."""


def clock_difference(index: FrameIndex, trajectory: Trajectory) -> str:
    """How far the times of the poses lie from the frames', and what to do; "" where they overlap or
    are not known.
    """
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
            f"the times of the file are {file}, those of the frames {dive}: one starts at 0 "
            f"with the dive: add {later}"
        )
    ahead_h = float(poses.min() - frames.min()) / 3600
    by = f"{abs(ahead_h):.3f} h" if abs(ahead_h) < DAYS_H else f"{abs(ahead_h) / 24:.3f} days"
    return (
        f"it begins {by} {'after' if ahead_h > 0 else 'before'} the first frame: if one clock "
        "showed local time, or was not set, shift the times of the file by that"
    )


# Alignment of a track by the pictures to positions that are far less accurate than it is, such as
# a buoy's satellite fixes.
#
# A prior so loose moves and turns a track about the vertical as a whole, and does not bend it.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FixSettings:
    """When fixes determine where a track lies."""

    fewest: int = 5  # frames with a fix
    rounds: int = 10  # of weighted least squares; it takes 4
    # standard error of the heading: they scatter by half of what the track reaches from its middle
    most_heading_deg: float = 30.0


SETTINGS = FixSettings()


@dataclass(frozen=True, eq=False)
class FixFit:
    """T: (4, 4) to the fixes' world. scatter_m: of a fix, east or north. heading_std_deg: as if all
    fixes shared one error, which those of one buoy on one rope nearly do: more of them do not make
    the heading surer, a longer track does.
    """

    T: Array
    scatter_m: float
    heading_std_deg: float


def at_fixes(
    own: Placement, index: FrameIndex, trajectory: Trajectory, config: MappingConfig
) -> Placement:
    """The track, level and z up, where the fixes say. Its mean height becomes theirs.

    Components for which they do not tell are left out, and named. Raises MappingError if that is
    the largest one.
    """
    fixes = assign(index, trajectory, config).T_world_camera[:, :3, 3]
    T, components, unplaced, warnings = (
        own.T_world_camera.copy(),
        own.components.copy(),
        [*own.unplaced],
        [],
    )
    for component in range(len(own.sizes)):
        frames = own.frames_of(component)
        fixed = frames[np.isfinite(fixes[frames]).all(axis=1)]
        fit = fit_to_fixes(T[fixed, :3, 3], fixes[fixed], config.prior_position_std_m)
        if fit is not None:
            T[frames] = fit.T @ T[frames]
            warnings.append(
                f"the track lies by {len(fixed)} fixes, which scatter by {fit.scatter_m:.1f} m "
                f"about it; the standard error of its heading is {fit.heading_std_deg:.0f} degrees"
            )
            continue
        reason = f"{len(fixed)} fixes along its track do not determine its heading"
        if not len(fixed) and (fix := clock_difference(index, trajectory)):
            raise MappingError(f"no frame has a fix at its time: {fix}")
        if component == 0:
            raise MappingError(
                f"{reason}: the dive must be longer than they scatter; map it without --poses"
            )
        unplaced += [Unplaced(index.names[i], reason) for i in frames]
        T[frames], components[frames] = np.nan, -1
    kept = components >= 0
    components[kept] = np.unique(components[kept], return_inverse=True)[1]
    placed = replace(own, T_world_camera=T, components=components, unplaced=tuple(unplaced))
    return placed.with_warnings(*warnings[:1])


def fit_to_fixes(track_m: Array, fixes_m: Array, std_m: float | None) -> FixFit | None:
    """The motion that keeps the vertical, from a track (n, 3) to fixes (n, 3), outliers apart; None
    where they do not tell it.

    std_m: standard error of a fix, east or north; None: from how they scatter.
    """
    if len(track_m) < SETTINGS.fewest:
        return None
    weights, known_m = np.ones(len(track_m)), std_m
    for _ in range(SETTINGS.rounds):
        T, arms = _weighted(track_m, fixes_m, weights)
        off = (track_m @ T[:3, :3].T + T[:3, 3] - fixes_m)[:, :2]
        scatter_m = known_m or max(deviation_about_zero(off), 1e-3)
        weights = biweight(np.linalg.norm(off, axis=1) / (TUKEY * scatter_m))
        if np.count_nonzero(weights) < SETTINGS.fewest:
            return None
    reach_m = float(np.sqrt((weights[:, None] * arms**2).sum() / weights.sum()))
    heading_deg = float(np.degrees(scatter_m / max(reach_m, 1e-9)))
    return FixFit(T, scatter_m, heading_deg) if heading_deg <= SETTINGS.most_heading_deg else None


def _weighted(track_m: Array, fixes_m: Array, weights: Array) -> tuple[Array, Array]:
    """The best turn about the vertical and shift, and where the track lies about its middle, east
    and north (n, 2).
    """
    middle, there = (np.average(points, axis=0, weights=weights) for points in (track_m, fixes_m))
    a, b = (track_m - middle)[:, :2], (fixes_m - there)[:, :2]
    yaw = np.arctan2(
        weights @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), weights @ (a * b).sum(axis=1)
    )
    R = rotation_from_vector(np.array([0.0, 0.0, float(yaw)]))
    return pose(R, there - R @ middle), a


# The upright direction of a track: checked where the poses know it, estimated from the bottom
# where they do not.

MAX_ABOVE = 0.3
"""The bottom may lie above the cameras by this fraction of its range, as an overhang does; more is
a map upside down.
"""
SAMPLE = 20_000
"""Points that the plane through the bottom is fitted to, at least."""


def upright(placement: Placement, index: FrameIndex, up: str) -> Placement:
    """Check that the bottom lies below the cameras; where the trajectory does not know up, level
    the map to its bottom.

    Raises MappingError for a map upside down.
    """
    seen = [int(i) for i in np.flatnonzero(placement.components >= 0) if len(index.points_m[i])]
    if not seen:
        raise MappingError("no placed frame has a measured range: there is nothing to fuse")
    if up == "z":
        _check(placement.T_world_camera, index, seen)
        return placement
    T = placement.T_world_camera.copy()
    for component in range(placement.components.max() + 1):
        own = [i for i in seen if placement.components[i] == component]
        if own:
            members = placement.frames_of(component)
            T[members] = _level(index, T, own) @ T[members]
    return replace(placement, T_world_camera=T).with_warnings(
        "the vertical is not known: the map was leveled to its mean bottom"
    )


def _check(T: NDArray[np.float64], index: FrameIndex, frames: list[int]) -> None:
    above_m = [float(np.median(index.points_m[i] @ T[i, 2, :3])) for i in frames]
    reach_m = [float(np.median(np.linalg.norm(index.points_m[i], axis=1))) for i in frames]
    if np.median(np.array(above_m) / np.array(reach_m)) > MAX_ABOVE:
        raise MappingError(
            f"the trajectory puts the bottom {np.median(above_m):.1f} m above the cameras: its z "
            "axis points down, or its poses "
            "are world-to-camera: give east-north-up, camera-to-world poses"
        )


def _level(index: FrameIndex, T: NDArray[np.float64], frames: list[int]) -> NDArray[np.float64]:
    """(4, 4) turn that makes the plane through all that was seen horizontal, below the cameras."""
    points = np.concatenate([transformed(T[i], index.points_m[i]) for i in frames])
    center = points.mean(axis=0)
    normal = np.linalg.svd(points[:: max(1, len(points) // SAMPLE)] - center, full_matrices=False)[
        2
    ][2]
    towards_cameras = T[frames, :3, 3].mean(axis=0) - center
    return pose(rotation_to_z(normal * np.sign(normal @ towards_cameras)), np.zeros(3))
