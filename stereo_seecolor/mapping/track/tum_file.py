"""The map's trajectory as TUM: ``timestamp tx ty tz qx qy qz qw``, camera to world."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.geometry import rotation_vector
from stereo_seecolor.mapping.frame_index import FrameIndex


def write_tum(path: Path, index: FrameIndex, T_world_camera: NDArray[np.float64], frames: NDArray[np.int64]) -> None:
    """One line a frame, the frame's name in a comment before it; a frame without time gets its number as time."""
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for i in frames:
        T, time_s = T_world_camera[i], index.timestamps_s[i]
        vector = rotation_vector(T[:3, :3])
        angle = float(np.linalg.norm(vector))
        xyz = vector / angle * np.sin(angle / 2) if angle > 1e-12 else vector / 2
        numbers = [*T[:3, 3], *xyz, np.cos(angle / 2)]
        lines.append(f"# {index.names[i]}")
        lines.append(f"{time_s if np.isfinite(time_s) else float(i):.6f} " + " ".join(f"{value:.9f}" for value in numbers))
    path.write_text("\n".join(lines) + "\n")
