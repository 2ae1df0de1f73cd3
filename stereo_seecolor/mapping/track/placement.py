"""Which pose belongs to which frame; which frames have none, and where the track tears."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.geometry import interpolate, rotation_to_z
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.recovered import Unplaced
from stereo_seecolor.records import Trajectory

END_TOLERANCE_S = 0.01
MIN_JUMP_M = 2.0
JUMP_STEPS = 10.0


@dataclass(frozen=True, eq=False)
class Placement:
    """Poses of a survey's frames.

    T_world_camera: (N, 4, 4), NaN for a frame without a place. pieces: (N,) int, -1 for those; frames of two pieces have no
    reliable place relative to each other. unplaced: those frames by name. warnings: what a person should know.
    """

    T_world_camera: NDArray[np.float64]
    pieces: NDArray[np.int64]
    unplaced: tuple[Unplaced, ...] = ()
    warnings: tuple[str, ...] = ()


def place(index: FrameIndex, trajectory: Trajectory, config: MappingConfig) -> Placement:
    """Match a trajectory to frames: by name, else by time (interpolated), else, where neither says anything, by order.

    Poses that are not finite, or that jump away and back, leave their frame out; a jump that stays breaks the track into
    pieces. Raises MappingError if nothing matches, or if the bottom lies above the cameras.
    """
    T, reasons, warnings = _match(index, trajectory, config)
    T[list(index.lost)] = np.nan
    reasons |= index.lost
    for name, count in Counter(index.names).items():
        if count > 1:
            warnings.append(f"{count} pairs are called {name}")
    _drop_spikes(T, index, reasons, config)
    pieces, breaks = _pieces(T, index, config)
    if not (pieces >= 0).any():
        first = next(iter(reasons.values()), "")
        raise MappingError(f"no frame has a pose in the trajectory ({first}): compare the frames' names and times with the file's")
    unplaced = tuple(Unplaced(index.names[i], reasons[i]) for i in sorted(reasons))
    return Placement(T, pieces, unplaced, tuple(warnings + breaks))


def upright(placement: Placement, index: FrameIndex, up: str) -> Placement:
    """Check that the bottom lies below the cameras; where the trajectory does not know up, level the map to its bottom.

    Raises MappingError for a map upside down.
    """
    placed = np.flatnonzero(placement.pieces >= 0)
    T = placement.T_world_camera
    seen = [int(i) for i in placed if len(index.points_m[i])]
    if not seen:
        raise MappingError("no placed frame has a measured range: there is nothing to fuse")
    if up == "z":
        below = [float(np.median(index.points_m[i] @ T[i, 2, :3])) for i in seen]
        reach = [float(np.median(np.linalg.norm(index.points_m[i], axis=1))) for i in seen]
        if np.median(np.array(below) / np.array(reach)) > 0.3:
            raise MappingError(
                f"the trajectory puts the bottom {np.median(below):.1f} m above the cameras: its z axis points down, or its poses "
                "are world-to-camera: give east-north-up, camera-to-world poses"
            )
        return placement
    T = T.copy()
    for piece in range(placement.pieces.max() + 1):
        own = [i for i in seen if placement.pieces[i] == piece]
        if own:
            T[placement.pieces == piece] = _level(index, T, own) @ T[placement.pieces == piece]
    note = "the poses do not know up: the map was levelled to its mean bottom"
    return Placement(T, placement.pieces, placement.unplaced, (*placement.warnings, note))


def _level(index: FrameIndex, T: NDArray[np.float64], frames: list[int]) -> NDArray[np.float64]:
    """(4, 4) turn that makes the plane through all that was seen horizontal, below the cameras."""
    points = np.concatenate([index.points_m[i] @ T[i, :3, :3].T + T[i, :3, 3] for i in frames])
    center = points.mean(axis=0)
    normal = np.linalg.svd(points[:: max(1, len(points) // 20000)] - center, full_matrices=False)[2][2]
    towards_cameras = T[frames, :3, 3].mean(axis=0) - center
    level = np.eye(4)
    level[:3, :3] = rotation_to_z(normal * np.sign(normal @ towards_cameras))
    return level


def _match(
    index: FrameIndex, trajectory: Trajectory, config: MappingConfig
) -> tuple[NDArray[np.float64], dict[int, str], list[str]]:
    by_stem: dict[str, list[int]] = {}
    for i, name in enumerate(trajectory.names):
        by_stem.setdefault(_stem(name), []).append(i)
    by_stem.pop("", None)
    if by_stem.keys() & {_stem(name) for name in index.names}:
        return _by_name(index, trajectory, by_stem)
    if np.isfinite(trajectory.timestamps_s).any() and np.isfinite(index.timestamps_s).any():
        return _by_time(index, trajectory, config)
    if not by_stem and len(trajectory.T_world_camera) == len(index.names):
        T = trajectory.T_world_camera.copy()
        reasons = {int(i): "its pose is not finite" for i in np.flatnonzero(~_finite(T))}
        T[list(reasons)] = np.nan
        return T, reasons, ["the trajectory names no frames and holds no common time: poses were taken in order"]
    raise MappingError(
        f"the {len(trajectory.T_world_camera)} poses of the trajectory cannot be matched to the {len(index.names)} frames: no "
        f"common names (for example {trajectory.names[0]!r} and {index.names[0]!r}), no common times, not the same number"
    )


def _by_name(
    index: FrameIndex, trajectory: Trajectory, by_stem: dict[str, list[int]]
) -> tuple[NDArray[np.float64], dict[int, str], list[str]]:
    T = np.full((len(index.names), 4, 4), np.nan)
    reasons: dict[int, str] = {}
    used: dict[int, str] = {}
    finite = _finite(trajectory.T_world_camera)
    for i, name in enumerate(index.names):
        poses = by_stem.get(_stem(name), [])
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
    return T, reasons, []


def _by_time(
    index: FrameIndex, trajectory: Trajectory, config: MappingConfig
) -> tuple[NDArray[np.float64], dict[int, str], list[str]]:
    warnings = []
    finite = _finite(trajectory.T_world_camera) & np.isfinite(trajectory.timestamps_s)
    if not finite.all():
        warnings.append(f"{np.count_nonzero(~finite)} poses of the trajectory are not finite and were left out")
    times, first = np.unique(trajectory.timestamps_s[finite], return_index=True)
    poses = trajectory.T_world_camera[finite][first]
    if len(times) < np.count_nonzero(finite):
        warnings.append(f"{np.count_nonzero(finite) - len(times)} poses repeat a time stamp: the first of each was taken")
    if (np.diff(trajectory.timestamps_s[finite]) < 0).any():
        warnings.append("the trajectory's poses are out of order: they were sorted by time")
    T = np.full((len(index.names), 4, 4), np.nan)
    reasons: dict[int, str] = {}
    for i, time_s in enumerate(index.timestamps_s):
        pose = _at(times, poses, time_s, config.max_gap_s)
        if pose is None:
            reasons[i] = "it has no time stamp" if np.isnan(time_s) else f"the trajectory has no pose within {config.max_gap_s:g} s"
        else:
            T[i] = pose
    return T, reasons, warnings


def _at(times: NDArray[np.float64], poses: NDArray[np.float64], time_s: float, max_gap_s: float) -> NDArray[np.float64] | None:
    if np.isnan(time_s) or not len(times):
        return None
    after = int(np.searchsorted(times, time_s))
    nearest = min((i for i in (after - 1, after) if 0 <= i < len(times)), key=lambda i: abs(times[i] - time_s))
    if abs(times[nearest] - time_s) <= END_TOLERANCE_S and (after in (0, len(times)) or times[nearest] == time_s):
        return np.asarray(poses[nearest])
    if after in (0, len(times)) or times[after] - times[after - 1] > max_gap_s:
        return None
    share = (time_s - times[after - 1]) / (times[after] - times[after - 1])
    return interpolate(poses[after - 1], poses[after], float(share))


def _drop_spikes(T: NDArray[np.float64], index: FrameIndex, reasons: dict[int, str], config: MappingConfig) -> None:
    """Take out single poses that jump away and back."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed, config)
    for before, spike, after in zip(placed, placed[1:], placed[2:], strict=False):
        away = _distance_m(T, before, spike) > limit(before, spike) and _distance_m(T, spike, after) > limit(spike, after)
        if away and _distance_m(T, before, after) <= limit(before, after) and np.isfinite(T[before]).all():
            reasons[spike] = f"its pose jumps {_distance_m(T, before, spike):.1f} m away and back"
            T[spike] = np.nan


def _pieces(T: NDArray[np.float64], index: FrameIndex, config: MappingConfig) -> tuple[NDArray[np.int64], list[str]]:
    """Number the stretches between jumps; the one with most frames is piece 0."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed, config)
    stretches: list[list[int]] = []
    warnings = []
    for k, i in enumerate(placed):
        if k == 0 or _distance_m(T, placed[k - 1], i) > limit(placed[k - 1], i):
            if k:
                jump_m, before = _distance_m(T, placed[k - 1], i), index.names[placed[k - 1]]
                warnings.append(f"the track jumps {jump_m:.1f} m between {before} and {index.names[i]}: the map breaks there")
            stretches.append([])
        stretches[-1].append(i)
    pieces = np.full(len(T), -1)
    for number, stretch in enumerate(sorted(stretches, key=len, reverse=True)):
        pieces[stretch] = number
    return pieces, warnings


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


def _finite(T: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(T).all(axis=(1, 2)))


def _stem(name: str) -> str:
    return PurePath(name.replace("\\", "/")).stem if name else ""
