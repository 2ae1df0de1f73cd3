"""Tables of poses: TUM, KITTI, TartanAir, and any with a header."""

import re

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MountConfig
from stereo_seecolor.geometry import pose, rotation_from_quaternion
from stereo_seecolor.inputs.trajectories.axes import poses_from_ned
from stereo_seecolor.inputs.trajectories.table import Lines, Table, is_number, read_lines, seconds
from stereo_seecolor.records import Trajectory

# TUM: ``timestamp tx ty tz qx qy qz qw``, seconds, camera to world, w last.


def is_tum(lines: Lines) -> bool:
    """Eight numbers a line, with or without commas."""
    fields = _fields(lines.first)
    return len(fields) == 8 and is_number(fields[0])


def read_tum(lines: Lines, mount: MountConfig) -> Trajectory:
    """Times in ms, us or ns are told by their size."""
    times, rows = [], []
    for number, line in lines.content:
        fields = _fields(line)
        if len(fields) != 8:
            raise lines.error(
                number,
                f"a TUM pose has 8 numbers (timestamp tx ty tz qx qy qz qw), got {len(fields)}",
            )
        rows.append(lines.numbers(number, fields[1:]))
        try:
            times.append(seconds(fields[0]))
        except ValueError as error:
            raise lines.error(number, f"expected numbers, got {line[:60]!r}") from error
    return trajectory_of(np.array(times), np.array(rows))


def trajectory_of(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> Trajectory:
    """Make a trajectory of (N, 7) x y z qx qy qz qw.

    World z is up unless the first pose is the identity: then the world is the first camera, and up
    is unknown.
    """
    T = pose(rotation_from_quaternion(values[:, 3:]), values[:, :3])
    starts_at_identity = np.allclose(T[0], np.eye(4), atol=1e-6)
    return Trajectory(("",) * len(T), times_s, T, up="unknown" if starts_at_identity else "z")


def _fields(line: str) -> list[str]:
    return line.replace(",", " ").split()


# KITTI: a row-major 3x4 camera-to-world matrix a line, line i is frame i; ``times.txt`` beside it
# where there is one.


def is_kitti(lines: Lines) -> bool:
    """Twelve numbers a line."""
    return len(lines.first.split()) == 12


def read_kitti(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames in order, or by time where times.txt has as many lines; up is
    unknown.
    """
    rows = []
    for number, line in lines.content:
        values = lines.numbers(number, line.split())
        if len(values) != 12:
            raise lines.error(number, f"a KITTI pose has 12 numbers, got {len(values)}")
        rows.append(values)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = np.reshape(rows, (-1, 3, 4))
    return Trajectory(("",) * len(T), _times(lines, len(T)), T, up="unknown")


def _times(lines: Lines, count: int) -> np.ndarray:
    path = lines.path.with_name("times.txt")
    if not path.is_file() or path == lines.path:
        return np.full(count, np.nan)
    times = read_lines(path)
    values = [times.numbers(number, [line])[0] for number, line in times.content]
    if len(values) != count:
        raise times.error(
            len(values), f"{len(values)} times for the {count} poses of {lines.path.name}"
        )
    return np.array(values)


# TartanAir's ``pose_left.txt``: ``x y z qx qy qz qw`` a line, north-east-down, without times;
# line i is frame i.

R_FORWARD_RIGHT_DOWN_CAMERA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""The camera's x right, y down, z forward to the axes of the file's poses."""

UNIT_WITHIN = 0.01
"""Of the length of a quaternion; seven other numbers hardly end in four of length one."""


def is_tartanair(lines: Lines) -> bool:
    """Seven numbers a line, of which the last four are a quaternion."""
    fields = lines.first.split()
    if len(fields) != 7 or not all(map(is_number, fields)):
        return False
    return abs(float(np.linalg.norm([float(field) for field in fields[3:]])) - 1) < UNIT_WITHIN


def read_tartanair(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames in order; z up."""
    rows = []
    for number, line in lines.content:
        values = lines.numbers(number, line.split())
        if len(values) != 7:
            raise lines.error(
                number, f"a pose of TartanAir has 7 numbers (x y z qx qy qz qw), got {len(values)}"
            )
        rows.append(values)
    table = np.array(rows)
    T = poses_from_ned(
        rotation_from_quaternion(table[:, 3:]) @ R_FORWARD_RIGHT_DOWN_CAMERA, table[:, :3]
    )
    return Trajectory(("",) * len(T), np.full(len(T), np.nan), T)


# A table of poses with a header: time, x, y, z and a quaternion by the names of their columns, as
# of EuRoC and ROS.

_TIME = r"(.*[._])?(time_?)?stamps?([._](sec|s|ns|us|ms))?|%?time|t"
_POSITION = r"(.*[._])?(t|p|pos|position|translation)?([._].*)?[._]?{}"
_ROTATION = r"(.*[._])?(q|quat|quaternion|orientation|rotation)([._].*)?[._]?{}"
_SEPARATORS = (",", ";", "\t")


def is_pose_table(lines: Lines) -> bool:
    """A header that names a time, a position and a quaternion."""
    return _columns(lines) is not None


def read_pose_table(lines: Lines, mount: MountConfig) -> Trajectory:
    """Camera to world, as TUM's; times in seconds, ms, us or ns since 1970, or ISO 8601."""
    columns = _columns(lines)
    assert columns
    rows = tuple(row for row in lines.content if row[1].lstrip("#% ") != lines.header)
    table = Table.read(lines, _separator(lines), _names(lines), rows)
    try:
        times = [seconds(text) for text in table.text(columns[0])]
    except ValueError as error:
        raise lines.error(rows[0][0], f"no time in column {columns[0]!r}: {error}") from error
    return trajectory_of(
        np.array(times), np.column_stack([table.column(name) for name in columns[1:]])
    )


def _columns(lines: Lines) -> list[str] | None:
    """Of time, x, y, z, qx, qy, qz, qw, in this order; None where one is missing."""
    names = _names(lines)
    bare = [re.sub(r"\s*[\[(][^\[\]()]*[\])]", "", name) for name in names]
    found: list[str] = []
    for pattern in (_TIME, *map(_POSITION.format, "xyz"), *map(_ROTATION.format, "xyzw")):
        fitting = (
            name
            for name, plain in zip(names, bare, strict=True)
            if name not in found and re.fullmatch(pattern, plain)
        )
        if (first := next(fitting, None)) is None:
            return None
        found.append(first)
    return found


def _names(lines: Lines) -> list[str]:
    return [name.strip().strip('"').lower() for name in lines.header.split(_separator(lines))]


def _separator(lines: Lines) -> str:
    return max(_SEPARATORS, key=lines.header.count)
