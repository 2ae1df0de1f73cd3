"""The upright direction of a track: checked against the poses, or from the bottom."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import rigid_transform, rotation_to_z, transform_points
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Placement

MAX_ABOVE = 0.3
"""The bottom may lie above the cameras by this fraction of its range, as an overhang does; more is
a map upside down.
"""
SAMPLE = 20_000
"""Points that the plane through the bottom is fitted to, at least."""


def upright(placement: Placement, index: FrameIndex, up: str) -> Placement:
    """Check that the bottom lies below the cameras; where the trajectory does not know up, level
    the map to its bottom.

    Raises MappingError for a map upside down.
    """
    placed = np.flatnonzero(placement.components >= 0).tolist()
    seen = [i for i in placed if len(index.points_m[i])]
    if not seen:
        raise MappingError("no frame of the track has a measured range: there is nothing to fuse")
    if up == "z":
        _check(placement.T_world_camera, index, seen)
        return placement
    T = placement.T_world_camera.copy()
    for component in range(placement.components.max() + 1):
        own = [i for i in seen if placement.components[i] == component]
        if own:
            members = placement.frames_of(component)
            T[members] = _level(index, T, own) @ T[members]
    return replace(placement, T_world_camera=T).with_warnings(
        "the vertical is unknown: the map was leveled to its mean bottom"
    )


def _check(T: NDArray[np.float64], index: FrameIndex, frames: list[int]) -> None:
    above_m = [float(np.median(index.points_m[i] @ T[i, 2, :3])) for i in frames]
    reach_m = [float(np.median(np.linalg.norm(index.points_m[i], axis=1))) for i in frames]
    if np.median(np.array(above_m) / np.array(reach_m)) > MAX_ABOVE:
        raise MappingError(
            f"the trajectory puts the bottom {np.median(above_m):.1f} m above the cameras: its z "
            "axis points down, or its poses "
            "are world-to-camera: give east-north-up, camera-to-world poses"
        )


def _level(index: FrameIndex, T: NDArray[np.float64], frames: list[int]) -> NDArray[np.float64]:
    """(4, 4) turn that makes the plane through all that was seen horizontal, below the cameras."""
    step = max(1, sum(len(index.points_m[i]) for i in frames) // SAMPLE)
    total, count, some = np.zeros(3), 0, []
    for i in frames:  # all at once would take more memory than all else
        points = transform_points(T[i], index.points_m[i])
        total = np.vstack([total, points]).sum(axis=0)
        some.append(points[-count % step :: step])
        count += len(points)
    center = total / count
    normal = np.linalg.svd(np.concatenate(some) - center, full_matrices=False)[2][2]
    towards_cameras = T[frames, :3, 3].mean(axis=0) - center
    return rigid_transform(rotation_to_z(normal * np.sign(normal @ towards_cameras)), np.zeros(3))
