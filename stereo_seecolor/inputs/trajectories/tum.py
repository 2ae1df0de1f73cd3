"""TUM: ``timestamp tx ty tz qx qy qz qw``, seconds, camera to world, w last."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MountConfig
from stereo_seecolor.geometry import pose, rotation_from_quaternion
from stereo_seecolor.inputs.trajectories.table import Lines, is_number
from stereo_seecolor.inputs.trajectories.times import seconds
from stereo_seecolor.records import Trajectory


def recognizes(lines: Lines) -> bool:
    """Eight numbers a line, with or without commas."""
    fields = _fields(lines.first)
    return len(fields) == 8 and is_number(fields[0])


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Times in ms, us or ns are told by their size."""
    times, rows = [], []
    for number, line in lines.content:
        fields = _fields(line)
        if len(fields) != 8:
            raise lines.error(number, f"a TUM pose has 8 numbers (timestamp tx ty tz qx qy qz qw), got {len(fields)}")
        rows.append(lines.numbers(number, fields[1:]))
        try:
            times.append(seconds(fields[0]))
        except ValueError as error:
            raise lines.error(number, f"expected numbers, got {line[:60]!r}") from error
    return trajectory_of(np.array(times), np.array(rows))


def trajectory_of(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> Trajectory:
    """Make a trajectory of (N, 7) x y z qx qy qz qw.

    World z is up unless the first pose is the identity: then the world is the first camera, and up is unknown.
    """
    T = pose(rotation_from_quaternion(values[:, 3:]), values[:, :3])
    starts_at_identity = np.allclose(T[0], np.eye(4), atol=1e-6)
    return Trajectory(("",) * len(T), times_s, T, up="unknown" if starts_at_identity else "z")


def _fields(line: str) -> list[str]:
    return line.replace(",", " ").split()
