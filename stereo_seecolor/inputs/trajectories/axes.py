"""Conversion of navigation's axes to the map's: north-east-down to east-north-up."""

import numpy as np

from calibration.transforms import rigid_transform, rotation_from_euler
from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import R_ENU_NED
from stereo_seecolor.records import Array


def poses_from_ned(R_ned_camera: Array, position_ned_m: Array) -> Array:
    """Camera poses in north-east-down to camera poses in east-north-up, (N, 4, 4)."""
    return rigid_transform(R_ENU_NED @ R_ned_camera, position_ned_m @ R_ENU_NED.T)


def mount_rotation(mount: MountConfig) -> Array:
    """The rotation from camera axes to vehicle axes: (3, 3)."""
    return rotation_from_euler(*np.radians(mount.rpy_deg))


def mount_offset_m(mount: MountConfig) -> Array:
    """The position of the camera in vehicle axes: (3,)."""
    return np.array(mount.xyz_m)
