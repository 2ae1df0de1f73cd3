"""From where the vehicle was on Earth to where the camera was in the map."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.axes import (
    mount_offset_m,
    mount_rotation,
    north_east_from_degrees,
    poses_from_ned,
    rotation_from_euler,
)
from stereo_seecolor.records import GeoOrigin, Trajectory


def camera_trajectory(
    names: tuple[str, ...],
    timestamps_s: NDArray[np.float64],
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    depth_m: NDArray[np.float64],
    attitude_deg: NDArray[np.float64],
    mount: MountConfig,
) -> Trajectory:
    """The raw camera's poses in east-north-up; the origin is the first position that is known, at the water's surface.

    attitude_deg: (N, 3) roll, pitch, heading of the vehicle. What is NaN gives a NaN pose.
    """
    known = np.flatnonzero(np.isfinite(latitude_deg) & np.isfinite(longitude_deg))
    first = int(known[0]) if known.size else 0
    origin = GeoOrigin(float(latitude_deg[first]), float(longitude_deg[first]))
    north_east = north_east_from_degrees(latitude_deg, longitude_deg, origin)
    R_ned_vehicle = rotation_from_euler(*np.radians(attitude_deg.T))
    position = np.concatenate([north_east, depth_m[:, None]], axis=1) + R_ned_vehicle @ mount_offset_m(mount)
    T = poses_from_ned(R_ned_vehicle @ mount_rotation(mount), position)
    return Trajectory(names, timestamps_s, T, origin=origin, camera="raw")
