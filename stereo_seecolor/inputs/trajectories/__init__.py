"""Trajectories of any format: ``read_trajectory`` recognizes the format by the content of the file.

Formats of many users are modules here; packages add others (``trajectory_format``).
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from stereo_seecolor.config import MappingConfig, MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.name_keys import side_of, without_side
from stereo_seecolor.inputs.trajectories import (
    colmap,
    column_map,
    converted,
    foreign,
    pose_table,
    poses,
    receivers,
)
from stereo_seecolor.inputs.trajectories.held_fixes import between_fixes
from stereo_seecolor.inputs.trajectories.table import Lines, read_lines
from stereo_seecolor.inputs.trajectories.trajectory_format import (
    FileFormat,
    TextFormat,
    added_formats,
)
from stereo_seecolor.records import Trajectory

TABLES = (
    TextFormat("table of poses", pose_table.is_pose_table, pose_table.read_pose_table),
    TextFormat("table of navigation", column_map.recognizes, column_map.read_by_names),
)
FORMATS = (
    TextFormat("COLMAP images.txt", colmap.is_colmap, colmap.read_colmap),
    TABLES[0],
    TextFormat("KITTI", poses.is_kitti, poses.read_kitti),
    TextFormat("TartanAir", poses.is_tartanair, poses.read_tartanair),
    TextFormat("NMEA, GPX or KML track", receivers.recognizes, receivers.read),
    TextFormat("TUM", poses.is_tum, poses.read_tum),
    TABLES[1],
)
"""In the order in which they are asked, after those that packages add."""


def read_trajectory(path: Path, mount: MountConfig | None = None) -> Trajectory:
    """Read the poses of the left camera from any known format.

    A pose that is not finite is kept as NaN, so that the map can name the frame that has none.

    Args:
        path: The file, a ROS bag, a table with a map of its columns:
            ``nav.csv:time=UTC,lat=Latitude,...`` (``column_map.ROLES``), or several tables of one
            dive with commas between: ``position.csv,attitude.csv,depth.csv``.
        mount: How the camera sits on the vehicle, for the formats that give the vehicle's attitude
            (oplab, ORCA, Matisse, bags).

    Returns:
        The poses; ``camera`` says whether they are those of the raw or of the rectified left
        camera.

    Raises:
        InputError: If the file cannot be read, is of no known format, or holds no pose.
    """
    mount = mount or MountConfig()
    for format in added_formats():
        if isinstance(format, FileFormat) and format.recognizes(path):
            return _of_fixes(_of_left(format.read(path, mount)))
    parts = [column_map.split_spec(part) for part in column_map.split_files(path)]
    if len(parts) > 1:
        tables = [_table(read_lines(file), columns) for file, columns in parts]
        trajectory = column_map.read_together(tables, mount)
    elif parts[0][1]:
        trajectory = column_map.read(*_table(read_lines(parts[0][0]), parts[0][1]), mount)
    else:
        known, lines = _known(read_lines(parts[0][0]))
        trajectory = known.read(lines, mount)
    if not np.isfinite(trajectory.T_world_camera).all(axis=(1, 2)).any():
        raise InputError(f"{path}: holds no finite pose")
    return _of_fixes(_of_left(trajectory))


def trajectory_format(path: Path) -> str | None:
    """The name of the format that a text file is read as; None where it is not a trajectory, by its
    first lines. Raises InputError.
    """
    found = _recognized(read_lines(path))
    return found[0].title if found else None


def rectified_trajectory(
    path: Path, config: MappingConfig, T_rectified_left: np.ndarray
) -> Trajectory:
    """Read the trajectory of the rectified left camera, whatever the file's poses are of.

    T_rectified_left: (4, 4), from the left camera as calibrated; a run's is in run.json.
    """
    trajectory = read_trajectory(path, config.mount)
    if config.poses_of != "format":
        trajectory = replace(trajectory, camera=config.poses_of)
    return trajectory.of_rectified(T_rectified_left)


def given_trajectory(
    poses: Path | None, config: MappingConfig, T_rectified_left: np.ndarray
) -> Trajectory | None:
    """Poses with the configured fixes, or either alone; None without any. Raises InputError."""
    track, fixes = (
        rectified_trajectory(path, config, T_rectified_left) if path else None
        for path in (poses, config.fixes)
    )
    return replace(track, absolute=fixes) if track and fixes else track or fixes


def trajectory_files(path: Path) -> tuple[Path, ...]:
    """The files read for a trajectory, given as to ``read_trajectory``. Raises InputError."""
    return tuple(column_map.split_spec(part)[0] for part in column_map.split_files(path))


def _table(lines: Lines, columns: Mapping[str, str]) -> tuple[Lines, Mapping[str, str]]:
    """A table with the map of its columns: as given, or by their names. A receiver's log is one."""
    if receivers.recognizes(lines):
        return receivers.table(lines, columns)
    for table in (lines, *converted.below(lines)):
        if column_map.has_columns(table, columns) if columns else column_map.recognizes(table):
            return table, columns or column_map.guessed(table)
    if not columns:
        raise InputError(
            f"{lines.path}: is not a table of navigation with times: only tables with times can "
            "be joined"
        )
    return lines, columns


def _of_left(trajectory: Trajectory) -> Trajectory:
    """Without the right camera's poses where images of both sides are named (``left/0001.png``)."""
    sides = [side_of(name) for name in trajectory.names]
    lefts = {
        without_side(name, "left")
        for name, side in zip(trajectory.names, sides, strict=True)
        if side == "left"
    }
    of_right = [
        side == "right" and without_side(name, side) in lefts
        for name, side in zip(trajectory.names, sides, strict=True)
    ]
    if not any(of_right):
        return trajectory
    kept = np.flatnonzero(~np.array(of_right))
    names = tuple(trajectory.names[i] for i in kept)
    return replace(
        trajectory,
        names=names,
        timestamps_s=trajectory.timestamps_s[kept],
        T_world_camera=trajectory.T_world_camera[kept],
    )


def _of_fixes(trajectory: Trajectory) -> Trajectory:
    """The poses with positions between the fixes that they repeat; heights between them, too, where
    these repeat as often.
    """
    if trajectory.fixes_s is not None:
        return trajectory
    T = trajectory.T_world_camera.copy()
    for axes in (3, 2):
        held = between_fixes(trajectory.timestamps_s, T[:, :axes, 3])
        if held.fixes_s is not None:
            T[:, :axes, 3] = held.positions
            notes = (*trajectory.notes, *held.notes)
            return replace(trajectory, T_world_camera=T, fixes_s=held.fixes_s, notes=notes)
    return trajectory


def _recognized(lines: Lines) -> tuple[TextFormat, Lines] | None:
    """The format, and the lines that it reads: a table may stand below other lines, or be JSON."""
    is_json = lines.first[:1] in ("{", "[")
    added = (format for format in added_formats() if isinstance(format, TextFormat))
    for format in (*added, *FORMATS):
        if is_json == format.is_json and format.recognizes(lines):
            return format, lines
    if is_json:
        records = converted.of_json(lines)
        return _recognized(records) if records else None
    for table in converted.below(lines):
        for format in TABLES:
            if format.recognizes(table):
                return format, table
    return None


def _known(lines: Lines) -> tuple[TextFormat, Lines]:
    if found := _recognized(lines):
        return found
    if kind := foreign.named("\n".join(lines.all[:50])):
        raise InputError(f"{lines.path}: is {kind}")
    for below in (lines, *converted.below(lines)):
        if table := column_map.describe_table(below):
            raise InputError(f"{lines.path}: {table}")
    if lines.first[:1] in ("{", "["):
        raise InputError(
            f"{lines.path}: is JSON without a list of records that name time, position, depth and "
            "heading, or of poses: save it as CSV with time, lat, lon, depth, heading"
        )
    titles = ", ".join(format.title for format in (*FORMATS, *added_formats()))
    raise InputError(
        f"{lines.path}: is not a trajectory of a known format ({titles}; or any table with a "
        "column map, nav.csv:time=...,lat=...,lon=...,depth=...,heading=...); first line: "
        f"{lines.first[:60]!r}"
    )
