"""``transforms.json`` of Blender's scripts, Instant-NGP and Nerfstudio: camera-to-world matrices in
the axes of OpenGL.
"""

import numpy as np

from calibration.bounded_text import load_json
from calibration.transforms import rigid_transform
from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.table import LARGEST, Lines
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.records import Trajectory

OPENGL_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""The camera's x right, y down, z forward to x right, y up, z backward."""


def recognizes(lines: Lines) -> bool:
    """An object of JSON with a ``transform_matrix``."""
    return lines.first.startswith("{") and any('"transform_matrix"' in line for line in lines.all)


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames by the names of their images; up and the scale are unknown. The images
    are taken to be the raw ones.
    """
    try:
        frames = load_json("\n".join(lines.all))["frames"]
        names = tuple(str(frame["file_path"]) for frame in frames)
        T = np.array([frame["transform_matrix"] for frame in frames], dtype=np.float64)[:, :3]
    except (ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        raise InputError(
            f"{lines.path}: no frames with a file_path and a 4x4 transform_matrix each "
            f"({error!r:.80})"
        ) from error
    if T.shape[1:] != (3, 4) or (np.abs(T) > LARGEST).any():
        raise InputError(
            f"{lines.path}: transform_matrix: expected 4x4 numbers of meters a frame, got shape "
            f"{T.shape}"
        )
    return Trajectory(
        names, np.full(len(T), np.nan), _rigid(T) @ OPENGL_OPENCV, up="unknown", camera="raw"
    )


def _rigid(T: np.ndarray) -> np.ndarray:
    """(N, 4, 4) of (N, 3, 4), the axes of length one: Blender leaves an object's scale in them; NaN
    where one has none.
    """
    lengths = np.linalg.norm(T[:, :, :3], axis=1, keepdims=True)
    return rigid_transform(T[:, :, :3] / np.where(lengths > 0, lengths, np.nan), T[:, :, 3])


FORMAT = TextFormat("transforms.json", recognizes, read, is_json=True)
