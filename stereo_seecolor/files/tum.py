"""TUM: ``timestamp tx ty tz qx qy qz qw``, seconds and meters, camera to world, w last."""

from pathlib import Path

import numpy as np

from calibration.transforms import quaternion
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.records import Array, Trajectory

_HEADER = "# timestamp tx ty tz qx qy qz qw: the rectified left camera in the world, meters"


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write one line for each pose, after a comment with any frame's name. Raises OutputError.

    A pose without time gets its number as time.
    """
    times = np.where(
        np.isfinite(trajectory.timestamps_s),
        trajectory.timestamps_s,
        np.arange(len(trajectory.names)),
    )
    lines = [_HEADER]
    for name, time_s, T in zip(trajectory.names, times, trajectory.T_world_camera, strict=True):
        lines += [f"# {name}"] if name else []
        lines.append(f"{time_s:.6f} " + " ".join(f"{value:.9f}" for value in _numbers(T)))
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def _numbers(T: Array) -> Array:
    return np.concatenate([T[:3, 3], quaternion(T[:3, :3])])
