"""Conversion of navigation's axes to the map's: north-east-down to east-north-up, Euler angles."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.transforms import rigid_transform
from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import R_ENU_NED


def rotation_from_euler(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> NDArray[np.float64]:
    """Rz(yaw) Ry(pitch) Rx(roll), radians, shape (..., 3, 3): body axes to the axes the angles are
    measured in.
    """
    from scipy.spatial.transform import Rotation  # see geometry.py

    angles = np.stack(np.broadcast_arrays(yaw, pitch, roll), axis=-1).astype(np.float64)
    return np.asarray(Rotation.from_euler("ZYX", angles).as_matrix())


def poses_from_ned(
    R_ned_camera: NDArray[np.float64], position_ned_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Camera poses in north-east-down to camera poses in east-north-up, (N, 4, 4)."""
    return rigid_transform(R_ENU_NED @ R_ned_camera, position_ned_m @ R_ENU_NED.T)


def mount_rotation(mount: MountConfig) -> NDArray[np.float64]:
    """The rotation from camera axes to vehicle axes: (3, 3)."""
    return rotation_from_euler(*np.radians(mount.rpy_deg))


def mount_offset_m(mount: MountConfig) -> NDArray[np.float64]:
    """The position of the camera in vehicle axes: (3,)."""
    return np.array(mount.xyz_m)
