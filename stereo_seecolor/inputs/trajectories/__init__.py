"""Trajectories in the formats of vehicles and other programs: ``read_trajectory`` recognizes the
format; each is a module.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from stereo_seecolor.config import MappingConfig, MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.name_keys import side_of, without_side
from stereo_seecolor.inputs.trajectories import (
    column_map,
    converted,
    foreign,
    models,
    poses,
    receivers,
    vehicles,
)
from stereo_seecolor.inputs.trajectories.table import Lines, read_lines
from stereo_seecolor.plugins import added, load
from stereo_seecolor.records import Trajectory

FORMATS = (
    "TUM, KITTI, TartanAir, transforms.json (NeRF), reconstruction.json (OpenSfM), COLMAP "
    "images.txt, Metashape cameras (XML) and reference (text), oplab, ACFR stereo_pose_est.data, "
    "ORCA, Matisse (CSV and dim2), NMEA, GPX, KML tracks, ROS bags, tables of poses or navigation "
    "whose header names the columns; or any table with a map of its columns,  "
    "nav.csv:time=...,lat=...,lon=...,depth=...,heading=..."
)

_Reader = Callable[[Lines, MountConfig], Trajectory]
_FORMATS: tuple[tuple[str, Callable[[Lines], bool], _Reader], ...] = (
    ("Metashape cameras", models.is_metashape_xml, models.read_metashape_xml),
    ("Metashape reference", models.is_metashape_reference, models.read_metashape_reference),
    ("ACFR stereo_pose_est.data", vehicles.is_acfr, vehicles.read_acfr),
    ("COLMAP images.txt", models.is_colmap, models.read_colmap),
    ("oplab", vehicles.is_oplab, vehicles.read_oplab),
    ("ORCA", vehicles.is_orca, vehicles.read_orca),
    ("Matisse", vehicles.is_matisse, vehicles.read_matisse),
    ("table of poses", poses.is_pose_table, poses.read_pose_table),
    ("KITTI", poses.is_kitti, poses.read_kitti),
    ("TartanAir", poses.is_tartanair, poses.read_tartanair),
    ("NMEA, GPX or KML track", receivers.recognizes, receivers.read),
    ("reconstruction.json", models.is_opensfm, models.read_opensfm),
    ("transforms.json", models.is_nerf, models.read_nerf),
    ("TUM", poses.is_tum, poses.read_tum),
    ("table of navigation", column_map.recognizes, column_map.read_by_names),
)


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
    for name in added("trajectory_formats"):
        plugin = load("trajectory_formats", name, needs=("recognizes", "read"))
        if plugin.recognizes(path):
            return _of_left(plugin.read(path, mount or MountConfig()))
    mount = mount or MountConfig()
    parts = [column_map.split_spec(part) for part in column_map.split_files(path)]
    if len(parts) > 1:
        tables = [_table(read_lines(file), columns) for file, columns in parts]
        trajectory = column_map.read_together(tables, mount)
    elif parts[0][1]:
        trajectory = column_map.read(*_table(read_lines(parts[0][0]), parts[0][1]), mount)
    else:
        reader, lines = _reader(read_lines(parts[0][0]))
        trajectory = reader(lines, mount)
    if not np.isfinite(trajectory.T_world_camera).all(axis=(1, 2)).any():
        raise InputError(f"{path}: holds no finite pose")
    return _of_left(trajectory)


def trajectory_format(path: Path) -> str | None:
    """The name of the format that a text file is read as; None where it is not a trajectory, by its
    first lines. Raises InputError.
    """
    found = _recognized(read_lines(path))
    return found[0] if found else None


def rectified_trajectory(
    path: Path, config: MappingConfig, T_rectified_left: np.ndarray
) -> Trajectory:
    """Read the trajectory of the rectified left camera, whatever camera or vehicle the file's poses
    are of.

    T_rectified_left: (4, 4), from the axes of the left camera as calibrated; a run's own is in its
    run.json.
    """
    trajectory = read_trajectory(path, config.mount)
    if config.poses_of != "format":
        trajectory = replace(trajectory, camera=config.poses_of)
    return trajectory.of_rectified(T_rectified_left)


def given_trajectory(
    poses: Path | None, config: MappingConfig, T_rectified_left: np.ndarray
) -> Trajectory | None:
    """Poses with the fixes of the configuration beside them, or either alone; None without any.
    Raises InputError.
    """
    track, fixes = (
        rectified_trajectory(path, config, T_rectified_left) if path else None
        for path in (poses, config.fixes)
    )
    return replace(track, absolute=fixes) if track and fixes else track or fixes


def trajectory_files(path: Path) -> tuple[Path, ...]:
    """The files that are read for a trajectory.

    Args:
        path: As given to ``read_trajectory``, with maps of columns or without.

    Returns:
        The files.

    Raises:
        InputError: For a bad map.
    """
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
            f"{lines.path}: is not a table of navigation with times: only those can be joined"
        )
    return lines, columns


def _of_left(trajectory: Trajectory) -> Trajectory:
    """Without the poses of the right camera where the file names both sides' images
    (``left/0001.png``, ``right/0001.png``).
    """
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


def _recognized(lines: Lines) -> tuple[str, _Reader, Lines] | None:
    """The format, its reader, and the lines that it reads: a table may stand below other lines, or
    be JSON.
    """
    is_json = lines.first[:1] in ("{", "[")
    for name, recognizes, read in _FORMATS:
        if is_json == name.endswith(".json") and recognizes(lines):
            return name, read, lines
    if is_json:
        records = converted.of_json(lines)
        return _recognized(records) if records else None
    tables = [format_ for format_ in _FORMATS if format_[0].startswith("table of")]
    for table in converted.below(lines):
        for name, recognizes, read in tables:
            if recognizes(table):
                return name, read, table
    return None


def _reader(lines: Lines) -> tuple[_Reader, Lines]:
    if found := _recognized(lines):
        return found[1:]
    if kind := foreign.named("\n".join(lines.all[:50])):
        raise InputError(f"{lines.path}: is {kind}")
    raise InputError(
        f"{lines.path}: is not a trajectory that is known here ({FORMATS}); first line: "
        f"{lines.first[:60]!r}"
    )
