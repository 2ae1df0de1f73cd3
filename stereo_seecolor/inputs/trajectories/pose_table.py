"""A table of poses with a header that names time, x, y, z, and quaternion (EuRoC, ROS)."""

import re
from collections.abc import Callable
from functools import partial

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.files.csv_tables import separator_of, split_fields
from stereo_seecolor.inputs.trajectories.poses import trajectory_of
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.times import column_seconds
from stereo_seecolor.records import Trajectory

_TIME = re.compile(r"(.*[._])?(time_?)?stamps?([._](sec|s|ns|us|ms))?|%?time|t")
_POSITION = {"", "t", "p", "pos", "position", "translation"}
_ROTATION = {"q", "quat", "quaternion", "orientation", "rotation"}


def is_pose_table(lines: Lines) -> bool:
    """A header that names a time, a position and a quaternion."""
    return _columns(lines) is not None


def read_pose_table(lines: Lines, mount: MountConfig) -> Trajectory:
    """Camera to world, as TUM's; times in seconds, ms, us or ns since 1970, or ISO 8601."""
    columns = _columns(lines)
    assert columns
    rows = tuple(row for row in lines.content if row[1].lstrip("#% ") != lines.header)
    table = Table.read(lines, separator_of(lines.header), _names(lines), rows, is_whole=True)
    try:
        times = column_seconds(table.text(columns[0]))
    except ValueError as error:
        raise lines.error(rows[0][0], f"no time in column {columns[0]!r}: {error}") from error
    return trajectory_of(
        np.array(times), np.column_stack([table.column(name) for name in columns[1:]])
    )


def _columns(lines: Lines) -> list[str] | None:
    """Of time, x, y, z, qx, qy, qz, qw, in this order; None where one is missing."""
    names = _names(lines)
    bare = [re.sub(r"(?<!\s)\s*[\[(][^\[\]()]*[\])]", "", name) for name in names]
    found: list[str] = []
    wanted: list[Callable[[str], object]] = [
        _TIME.fullmatch,
        *(partial(_is_of, _POSITION, axis) for axis in "xyz"),
        *(partial(_is_of, _ROTATION, axis) for axis in "xyzw"),
    ]
    for fits in wanted:
        fitting = (
            name
            for name, plain in zip(names, bare, strict=True)
            if name not in found and fits(plain)
        )
        if (first := next(fitting, None)) is None:
            return None
        found.append(first)
    return found


def _is_of(quantity: set[str], axis: str, name: str) -> bool:
    """Whether a name says an axis of a quantity: ``pose.position.x`` and ``px`` of a position."""
    parts = re.split("[._]", name.removesuffix(axis))
    return name.endswith(axis) and not quantity.isdisjoint(parts)


def _names(lines: Lines) -> list[str]:
    """In lower case, with points between the parts of a message's name."""
    names = split_fields(lines.header, separator_of(lines.header))
    return [name.lower().replace("/", ".").strip("._") for name in names]
