"""ACFR's stereo_pose_est.data, and the tracks of IMOS dives made of it (CSV): pose of the left
camera in north-east-down, Euler angles in radians, with both image names.
"""

from itertools import islice

import numpy as np

from calibration.transforms import rotation_from_euler
from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.axes import poses_from_ned
from stereo_seecolor.inputs.trajectories.converted import below
from stereo_seecolor.inputs.trajectories.table import Lines, Table, is_number
from stereo_seecolor.inputs.trajectories.times import column_seconds
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.inputs.trajectories.vehicle_track import origin_of
from stereo_seecolor.records import GeoOrigin, Trajectory

_WITH_DEGREES = 15  # columns of a pose with latitude and longitude
_WITHOUT_DEGREES = 13  # columns of one without
_OF_TRACK = {"year", "second", "depth", "roll", "pitch", "heading", "leftimage", "rightimage"}
_NORTH_EAST = ("northing", "easting"), ("local_north", "local_east")
MOST_REMARKS = 10
"""Lines above the names of columns of a track."""


def recognizes(lines: Lines) -> bool:
    """The first line's comment, or 13 or 15 columns with two names in them, or a track's header."""
    return (
        _track(lines) is not None
        or "STEREO_POSE_FILE" in " ".join(lines.all[:3])
        or _is_pose(lines.content[-1][1].split() if lines.content else [])
    )


def _is_pose(fields: list[str]) -> bool:
    """Five points of an image in a COLMAP file are 15 columns too, but all of them numbers."""
    names = {_WITH_DEGREES: fields[10:12], _WITHOUT_DEGREES: fields[8:10]}.get(len(fields), [])
    return bool(names) and not any(is_number(name) for name in names)


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """The angles are the raw camera's (x right, y down, z along its axis): no mount needed."""
    if track := _track(lines):
        return _read_track(track)
    origin, rows = _origin(lines)
    values, names = [], []
    for number, line in rows:
        fields = line.split()
        if len(fields) not in (_WITH_DEGREES, _WITHOUT_DEGREES):
            raise lines.error(
                number, f"a stereo pose has {_WITH_DEGREES} columns, got {len(fields)}"
            )
        first = 4 if len(fields) == _WITH_DEGREES else 2
        values.append(lines.numbers(number, [fields[1], *fields[first : first + 6]]))
        names.append(fields[first + 6])
    table = np.reshape(values, (-1, 7))
    T = poses_from_ned(rotation_from_euler(table[:, 4], table[:, 5], table[:, 6]), table[:, 1:4])
    return Trajectory(tuple(names), table[:, 0], T, origin=origin, camera="raw")


def _track(lines: Lines) -> Lines | None:
    """The lines of a track from the names of its columns on."""
    return next(
        (
            table
            for table in (lines, *islice(below(lines), MOST_REMARKS))
            if set(_names(table)) >= _OF_TRACK
        ),
        None,
    )


def _names(lines: Lines) -> list[str]:
    return [name.strip() for name in lines.header.lower().split(",")]


def _read_track(lines: Lines) -> Trajectory:
    names = _names(lines)
    table = Table.read(lines, ",", names, lines.content[1:])
    north_east = next((pair for pair in _NORTH_EAST if set(pair) <= set(names)), _NORTH_EAST[0])
    position, angles = (
        np.column_stack([table.column(name) for name in columns])
        for columns in ((*north_east, "depth"), ("roll", "pitch", "heading"))
    )
    if (np.abs(angles) > 2 * np.pi).any():
        raise InputError(
            f"{lines.path}: is a track of IMOS, whose angles are radians, but its angles reach "
            f"{np.nanmax(np.abs(angles)):.4g}: name its columns for those of another table"
        )
    latitude, longitude = (
        np.array(table.column(name, np.nan)) for name in ("latitude", "longitude")
    )
    return Trajectory(
        tuple(table.text("leftimage")),
        np.array(column_seconds(table.text("year month day hour minute second"))),
        poses_from_ned(rotation_from_euler(*angles.T), position),
        origin=origin_of(latitude, longitude, position[:, :2]),
        camera="raw",
    )


def _origin(lines: Lines) -> tuple[GeoOrigin | None, tuple[tuple[int, str], ...]]:
    """The first two lines hold latitude and longitude, bare or after ORIGIN_LATITUDE, ..."""
    head = [(number, line.split()) for number, line in lines.content[:2]]
    if len(head) < 2 or any(len(fields) > 2 for _, fields in head):
        return None, lines.content
    latitude, longitude = (lines.numbers(number, fields[-1:])[0] for number, fields in head)
    return GeoOrigin(latitude, longitude), lines.content[2:]


FORMAT = TextFormat("ACFR stereo poses", recognizes, read)
