"""KITTI: a row-major 3x4 camera-to-world matrix a line, line i is frame i; ``times.txt`` beside it where there is one."""

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.table import Lines, read_lines
from stereo_seecolor.records import Trajectory


def recognizes(lines: Lines) -> bool:
    """Twelve numbers a line."""
    return len(lines.first.split()) == 12


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames in order, or by time where times.txt has as many lines; up is unknown."""
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
        raise times.error(len(values), f"{len(values)} times for the {count} poses of {lines.path.name}")
    return np.array(values)
