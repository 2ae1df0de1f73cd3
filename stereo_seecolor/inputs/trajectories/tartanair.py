"""TartanAir's ``pose_left.txt``: ``x y z qx qy qz qw`` a line, north-east-down, without times; line i is frame i."""

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.geometry import rotation_from_quaternion
from stereo_seecolor.inputs.trajectories.axes import poses_from_ned
from stereo_seecolor.inputs.trajectories.table import Lines, is_number
from stereo_seecolor.records import Trajectory

R_FORWARD_RIGHT_DOWN_CAMERA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""The camera's x right, y down, z forward to the axes of the file's poses."""

UNIT_WITHIN = 0.01
"""Of the length of a quaternion; seven other numbers hardly end in four of length one."""


def recognizes(lines: Lines) -> bool:
    """Seven numbers a line, of which the last four are a quaternion."""
    fields = lines.first.split()
    if len(fields) != 7 or not all(map(is_number, fields)):
        return False
    return abs(float(np.linalg.norm([float(field) for field in fields[3:]])) - 1) < UNIT_WITHIN


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames in order; z up."""
    rows = []
    for number, line in lines.content:
        values = lines.numbers(number, line.split())
        if len(values) != 7:
            raise lines.error(number, f"a pose of TartanAir has 7 numbers (x y z qx qy qz qw), got {len(values)}")
        rows.append(values)
    table = np.array(rows)
    T = poses_from_ned(rotation_from_quaternion(table[:, 3:]) @ R_FORWARD_RIGHT_DOWN_CAMERA, table[:, :3])
    return Trajectory(("",) * len(T), np.full(len(T), np.nan), T)
