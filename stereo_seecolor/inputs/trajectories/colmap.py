"""COLMAP's images.txt: ``ID qw qx qy qz tx ty tz CAM NAME``, world to camera, w first, every second
line the image's points.
"""

import numpy as np

from calibration.transforms import inverse, rigid_transform, rotation_from_quaternion
from stereo_seecolor.config import MountConfig
from stereo_seecolor.files.text_documents import read_text
from stereo_seecolor.inputs.trajectories.table import Lines, is_number
from stereo_seecolor.records import Trajectory


def is_colmap(lines: Lines) -> bool:
    """The comment COLMAP writes, or ten fields: a number first, and a name last."""
    fields = lines.first.split()
    return any("QW, QX, QY, QZ" in line for line in lines.all[:6]) or (
        len(fields) == 10 and is_number(fields[0]) and not is_number(fields[9])
    )


def read_colmap(lines: Lines, mount: MountConfig) -> Trajectory:
    """COLMAP's world is arbitrary: up is unknown, and the scale unless the model is metric.

    The images it was given are taken to be the raw left ones (as they are, or undistorted, which
    does not turn them).
    """
    rows, names = [], []
    for number, line in _image_lines(lines):
        fields = line.split(maxsplit=9)
        if len(fields) < 10:
            raise lines.error(number, "expected ID qw qx qy qz tx ty tz CAM NAME")
        rows.append(lines.numbers(number, fields[1:8]))
        names.append(fields[9])
    table = np.reshape(rows, (-1, 7))
    R_camera_world = rotation_from_quaternion(table[:, [1, 2, 3, 0]])
    T = inverse(rigid_transform(R_camera_world, table[:, 4:]))
    return Trajectory(tuple(names), np.full(len(names), np.nan), T, up="unknown", camera="raw")


def _image_lines(lines: Lines) -> list[tuple[int, str]]:
    """Every second line that is not a comment; empty lines count: points may be none."""
    text = read_text(lines.path).splitlines()
    uncommented = [(i, line) for i, line in enumerate(text, start=1) if not line.startswith("#")]
    return [(i, line) for i, line in uncommented[::2] if line.strip()]
