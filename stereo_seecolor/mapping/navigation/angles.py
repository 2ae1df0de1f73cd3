"""Poses as they would be with other conventions of a vehicle's roll, pitch and heading."""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.transforms import inverse, rigid_transform, rotation_from_euler
from stereo_seecolor.earth import R_ENU_NED
from stereo_seecolor.records import Array

_CHANGES: dict[str, Callable[[Array], Array]] = {
    "headings counted counterclockwise from north": lambda a: a * [-1, 1, 1],
    "headings counted counterclockwise from east": lambda a: [90, 0, 0] + a * [-1, 1, 1],
    "roll and pitch exchanged": lambda a: a[:, [0, 2, 1]],
    "roll of the other sign (port down)": lambda a: a * [1, 1, -1],
    "pitch of the other sign (bow down)": lambda a: a * [1, -1, 1],
    "roll and pitch of the other sign": lambda a: a * [1, -1, -1],
    "heading, pitch and roll in radians": lambda a: np.degrees(a),
    "headings in radians": lambda a: a * [np.degrees(1), 1, 1],
    "pitch and roll in radians": lambda a: a * [1, np.degrees(1), np.degrees(1)],
}
"""What would be done to columns of heading, pitch and roll, degrees."""


def of_other_angles(
    T_world_camera: Array, T_vehicle_camera: Array | None
) -> Iterator[tuple[str, Array]]:
    """The poses (N, 4, 4) with other readings of the vehicle's angles; none where the file gives
    the camera's pose. T_vehicle_camera: (4, 4).
    """
    known = np.flatnonzero(np.isfinite(T_world_camera).all(axis=(1, 2)))
    if T_vehicle_camera is None or not known.size:
        return
    T_vehicle = T_world_camera[known] @ inverse(T_vehicle_camera)
    angles = Rotation.from_matrix(R_ENU_NED.T @ T_vehicle[:, :3, :3])
    read_deg = angles.as_euler("ZYX", degrees=True)
    for name, change in _CHANGES.items():
        yaw, pitch, roll = np.radians(change(read_deg)).T
        R = R_ENU_NED @ rotation_from_euler(roll, pitch, yaw)
        result = np.full_like(T_world_camera, np.nan)
        result[known] = rigid_transform(R, T_vehicle[:, :3, 3]) @ T_vehicle_camera
        yield name, result
