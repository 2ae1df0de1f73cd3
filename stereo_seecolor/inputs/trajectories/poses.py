"""Rows of numbers that are poses: TUM, KITTI, TartanAir.

TUM: ``timestamp tx ty tz qx qy qz qw``, seconds, camera to world, w last; with a name of an image
in place of the time too. KITTI: a row-major 3x4 camera-to-world matrix a line, line i is frame i;
``times.txt`` beside it where there is one; also a time or a name before it, and 4x4 matrices on one
line or on four. TartanAir's ``pose_left.txt``: ``x y z qx qy qz qw`` a line, north-east-down,
without times; line i is frame i.
"""

from dataclasses import replace

import numpy as np

from calibration.transforms import rigid_transform, rotation_from_quaternion
from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.axes import poses_from_ned
from stereo_seecolor.inputs.trajectories.table import Lines, is_number, read_lines
from stereo_seecolor.inputs.trajectories.times import seconds
from stereo_seecolor.records import Array, Trajectory


def is_tum(lines: Lines) -> bool:
    """A number or a name, and seven numbers a line, with or without commas."""
    fields = _fields(lines.first)
    return len(fields) == 8 and all(map(is_number, fields[1:]))


def read_tum(lines: Lines, mount: MountConfig) -> Trajectory:
    """The size of a time shows whether it is in ms, us or ns."""
    firsts, rows = _rows(lines, 7, "a TUM pose has 8 numbers (timestamp tx ty tz qx qy qz qw)")
    lengths = np.linalg.norm(rows[:, 3:], axis=1)
    if known := [length for length in lengths if length > 0]:  # zeros: a pose that was lost
        _check_rotation(lines, abs(np.median(known) - 1))
    return _named(trajectory_of(np.full(len(rows), np.nan), rows), lines, firsts)


def _rows(lines: Lines, count: int, form: str) -> tuple[list[str], Array]:
    """What stands before the numbers of each line, "" where nothing does, and the numbers. form: of
    a line, for errors.
    """
    firsts, rows = [], []
    width = len(_fields(lines.first))
    for number, line in lines.content:
        fields = _fields(line)
        if len(fields) != width:
            raise lines.error(number, f"{form}, got {len(fields)}")
        firsts.append(" ".join(fields[:-count]))
        rows.append(lines.numbers(number, fields[-count:]))
    return firsts, np.array(rows)


def _named(poses: Trajectory, lines: Lines, firsts: list[str]) -> Trajectory:
    """The poses with the times or names before them. Raises InputError for what is neither."""
    if not all(firsts):
        return poses
    if not any(map(is_number, firsts)) and all("." in first for first in firsts):
        return replace(poses, names=tuple(firsts))
    times = []
    for (number, line), first in zip(lines.content, firsts, strict=True):
        try:
            times.append(seconds(first))
        except ValueError as error:
            raise lines.error(number, f"expected numbers, got {line[:60]!r}") from error
    return replace(poses, timestamps_s=np.array(times))


def _check_rotation(lines: Lines, off_by: float) -> None:
    """Raises InputError for numbers that are no rotation, as those of another table."""
    if off_by > NO_ROTATION:
        raise lines.error(
            lines.content[0][0],
            "has as many numbers as a pose, but they hold no rotation: if they are other columns, "
            "write their names in a line above",
        )


def trajectory_of(times_s: Array, values: Array) -> Trajectory:
    """Make a trajectory of (N, 7) x y z qx qy qz qw.

    World z is up unless the first pose is the identity, which is then the world, with up unknown.
    """
    T = rigid_transform(rotation_from_quaternion(values[:, 3:]), values[:, :3])
    starts_at_identity = np.allclose(T[0], np.eye(4), atol=1e-6)
    return Trajectory(("",) * len(T), times_s, T, up="unknown" if starts_at_identity else "z")


def _fields(line: str) -> list[str]:
    """The cells of a row of numbers; commas are decimal commas between semicolons."""
    if ";" in line:
        return line.replace(",", ".").replace(";", " ").split()
    return line.replace(",", " ").split()


_LAST_ROW = [0.0, 0.0, 0.0, 1.0]
_WIDTHS = (12, 13, 16, 17)
NO_ROTATION = 0.1
"""Off the length of a quaternion or the product of a rotation with its transpose: rounded to two
digits a rotation is nearer.
"""


def is_kitti(lines: Lines) -> bool:
    """Twelve or sixteen numbers a line, alone or after a time or name, or blocks of four lines."""
    return _form(lines) is not None


def _form(lines: Lines) -> int | None:
    """How many numbers a pose has; 4 for a block of four lines."""
    fields = _fields(lines.first)
    numbers = fields if len(fields) % 4 == 0 else fields[1:]
    if len(fields) == 12 and 2 * sum(map(is_number, fields)) > len(fields):
        return 12  # a line that names what is wrong in it is better than none
    if len(fields) not in (4, *_WIDTHS) or not all(map(is_number, numbers)):
        return None
    values = [float(number) for number in numbers]
    if len(values) == 16 and values[12:] != _LAST_ROW:
        return None
    if len(values) == 4:
        fourth = [_fields(line) for _, line in lines.content[3::4]]
        whole = len(lines.content) % 4 == 0 and all(len(row) == 4 for row in fourth)
        if not (whole and all([float(x) for x in row] == _LAST_ROW for row in fourth)):
            return None
    return len(values)


def read_kitti(lines: Lines, mount: MountConfig) -> Trajectory:
    """In the order of the frames, or by time if times.txt has as many lines; up is unknown."""
    count = _form(lines)
    assert count
    form = f"a pose of {count} numbers" if count > 12 else "a KITTI pose has 12 numbers"
    firsts, values = _rows(lines, count, form)
    matrices = values.reshape(-1, 4, 4)[:, :3] if count in (4, 16) else values.reshape(-1, 3, 4)
    squares = matrices[..., :3] @ matrices[..., :3].swapaxes(1, 2)
    if known := [abs(R - np.eye(3)).max() for R in squares if np.isfinite(R).all() and R.any()]:
        _check_rotation(lines, np.median(known))
    T = rigid_transform(matrices[..., :3], matrices[..., 3])
    poses = Trajectory(("",) * len(T), np.full(len(T), np.nan), T, up="unknown")
    if any(firsts) and firsts != [str(i) for i in range(len(firsts))]:
        return _named(poses, lines, firsts)
    return replace(poses, timestamps_s=_times(lines, len(T)))


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


R_FORWARD_RIGHT_DOWN_CAMERA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""The camera's x right, y down, z forward to the axes of the file's poses."""

UNIT_WITHIN = 0.01
"""Of the length of a quaternion; seven other numbers hardly end in four of length one."""


def is_tartanair(lines: Lines) -> bool:
    """Seven numbers a line, of which the last four are a quaternion."""
    fields = _fields(lines.first)
    if len(fields) != 7 or not all(map(is_number, fields)):
        return False
    return abs(float(np.linalg.norm([float(field) for field in fields[3:]])) - 1) < UNIT_WITHIN


def read_tartanair(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames in order; z up."""
    _, table = _rows(lines, 7, "a pose of TartanAir has 7 numbers (x y z qx qy qz qw)")
    T = poses_from_ned(
        rotation_from_quaternion(table[:, 3:]) @ R_FORWARD_RIGHT_DOWN_CAMERA, table[:, :3]
    )
    return Trajectory(("",) * len(T), np.full(len(T), np.nan), T)
