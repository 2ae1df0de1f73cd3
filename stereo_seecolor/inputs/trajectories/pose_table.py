"""A table of poses with a header that names time or image, x, y, z, and quaternion (EuRoC, ROS)."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from calibration.formats.reading.aliases import METERS
from stereo_seecolor.config import MountConfig
from stereo_seecolor.files.csv_tables import separator_of, split_fields
from stereo_seecolor.inputs.trajectories.columns import named, unit
from stereo_seecolor.inputs.trajectories.poses import trajectory_of
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.times import column_seconds
from stereo_seecolor.records import Trajectory

_TIME = re.compile(r"((.*[._])?(time_?)?stamps?|%?time|t)([._](sec|s|ns|us|ms))?")
_UNIT = re.compile(r"[\[(]\s*(\w+)\s*[\])]")
_POSITION = {"", "t", "p", "pos", "position", "translation"}
_ROTATION = {"q", "quat", "quaternion", "orientation", "rotation"}


def is_pose_table(lines: Lines) -> bool:
    """A header that names a time or an image, a position and a quaternion."""
    return _columns(lines) is not None


def read_pose_table(lines: Lines, mount: MountConfig) -> Trajectory:
    """Camera to world, as TUM's; times in seconds, ms, us or ns since 1970, or ISO 8601; units of
    lengths in brackets (``[mm]``).
    """
    columns = _columns(lines)
    assert columns
    rows = tuple(row for row in lines.content if row[1].lstrip("#% ") != lines.header)
    table = Table.read(lines, separator_of(lines.header), _names(lines), rows, is_whole=True)
    values = np.column_stack([table.column(name) for name in columns[1:]])
    values[:, :3] *= [_meters(name) for name in columns[1:4]]
    poses = trajectory_of(np.full(len(values), np.nan), values)
    image = next((name for name in _names(lines) if _is_image(name)), "")
    names = tuple(table.text(image)) if image else ()
    if columns[0] == image or len(set(names)) == len(values):  # not that of a body, in all rows
        poses = replace(poses, names=names)
    if columns[0] == image:
        return poses
    texts = table.text(columns[0])
    try:
        times_s = np.array(column_seconds(texts))
    except ValueError as error:
        raise lines.error(rows[0][0], f"no time in column {columns[0]!r}: {error}") from error
    is_echo = columns[0] == "time" and any(name.startswith("field.") for name in table.rows[0][1])
    a_second = 1e-9 if is_echo else unit(columns[0])  # rostopic echo -p writes nanoseconds
    if a_second < 1 and all(text.strip().isdigit() for text in texts):
        times_s = a_second * np.array(list(map(float, texts)))
    return replace(poses, timestamps_s=times_s)


def _columns(lines: Lines) -> list[str] | None:
    """Of time or image, x, y, z, qx, qy, qz, qw, in this order; None where one is missing."""
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
        first = next(fitting, None) or (not found and next(filter(_is_image, names), None))
        if not first:
            return None
        found.append(first)
    return found


def _is_image(name: str) -> bool:
    own = named(name)
    return own is not None and own.role == "name"


def _meters(name: str) -> float:
    said = _UNIT.search(name)
    return METERS.get(said[1], 1.0) if said else 1.0


def _is_of(quantity: set[str], axis: str, name: str) -> bool:
    """Whether a name says an axis of a quantity: ``pose.position.x`` and ``px`` of a position."""
    parts = re.split("[._]", name.removesuffix(axis))
    return name.endswith(axis) and not quantity.isdisjoint(parts)


def _names(lines: Lines) -> list[str]:
    """In lower case, with points between the parts of a message's name."""
    names = split_fields(lines.header, separator_of(lines.header))
    return [name.lower().replace("/", ".").strip("._") for name in names]
