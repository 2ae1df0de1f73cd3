"""TUM: ``timestamp tx ty tz qx qy qz qw``, seconds, camera to world, w last."""

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.axes import poses, rotation_from_quaternion
from stereo_seecolor.inputs.trajectories.table import Lines, is_number
from stereo_seecolor.records import Trajectory


def recognizes(lines: Lines) -> bool:
    """Eight numbers a line."""
    fields = lines.first.split()
    return len(fields) == 8 and is_number(fields[0])


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """World z is up unless the first pose is the identity: then the world is the first camera, and up is unknown."""
    rows = []
    for number, line in lines.content:
        fields = line.split()
        if len(fields) != 8:
            raise lines.error(number, f"a TUM pose has 8 numbers (timestamp tx ty tz qx qy qz qw), got {len(fields)}")
        rows.append(lines.numbers(number, fields))
    table = np.array(rows)
    T = poses(rotation_from_quaternion(table[:, 4:]), table[:, 1:4])
    starts_at_identity = np.allclose(T[0], np.eye(4), atol=1e-6)
    return Trajectory(("",) * len(T), table[:, 0], T, up="unknown" if starts_at_identity else "z")
