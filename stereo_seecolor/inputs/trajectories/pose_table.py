"""A table of poses with a header: time, x, y, z and a quaternion by the names of their columns, as of EuRoC and ROS."""

import re

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.times import seconds
from stereo_seecolor.inputs.trajectories.tum import trajectory_of
from stereo_seecolor.records import Trajectory

_TIME = r"(.*[._])?(time_?)?stamps?([._](sec|s|ns|us|ms))?|%?time|t"
_POSITION = r"(.*[._])?(t|p|pos|position|translation)?([._].*)?[._]?{}"
_ROTATION = r"(.*[._])?(q|quat|quaternion|orientation|rotation)([._].*)?[._]?{}"
_SEPARATORS = (",", ";", "\t")


def recognizes(lines: Lines) -> bool:
    """A header that names a time, a position and a quaternion."""
    return _columns(lines) is not None


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Camera to world, as TUM's; times in seconds, ms, us or ns since 1970, or ISO 8601."""
    columns = _columns(lines)
    assert columns
    rows = tuple(row for row in lines.content if row[1].lstrip("#% ") != lines.header)
    table = Table.read(lines, _separator(lines), _names(lines), rows)
    try:
        times = [seconds(text) for text in table.text(columns[0])]
    except ValueError as error:
        raise lines.error(rows[0][0], f"no time in column {columns[0]!r}: {error}") from error
    return trajectory_of(np.array(times), np.column_stack([table.column(name) for name in columns[1:]]))


def _columns(lines: Lines) -> list[str] | None:
    """Of time, x, y, z, qx, qy, qz, qw, in this order; None where one is missing."""
    names = _names(lines)
    bare = [re.sub(r"\s*[\[(][^\[\]()]*[\])]", "", name) for name in names]
    found: list[str] = []
    for pattern in (_TIME, *map(_POSITION.format, "xyz"), *map(_ROTATION.format, "xyzw")):
        fitting = (name for name, plain in zip(names, bare, strict=True) if name not in found and re.fullmatch(pattern, plain))
        if (first := next(fitting, None)) is None:
            return None
        found.append(first)
    return found


def _names(lines: Lines) -> list[str]:
    return [name.strip().strip('"').lower() for name in lines.header.split(_separator(lines))]


def _separator(lines: Lines) -> str:
    return max(_SEPARATORS, key=lines.header.count)
