"""oplab's auv_ekf_<camera>.csv and auv_dr_<camera>.csv: the camera's position, but the VEHICLE's
roll, pitch and heading.
"""

import numpy as np

from calibration.transforms import rotation_from_euler
from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.axes import (
    mount_offset_m,
    mount_rotation,
    poses_from_ned,
)
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.inputs.trajectories.vehicle_track import origin_of
from stereo_seecolor.records import GeoOrigin, Trajectory


def recognizes(lines: Lines) -> bool:
    """The header oplab writes, with or without its ``#``."""
    return "northing [m]" in lines.all[0] and "relative_path" in lines.all[0]


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Position from northing, easting and the camera's depth; attitude with the mount's."""
    header = [name.strip().lower() for name in lines.all[0].lstrip("# ").split(",")]
    table = Table.read(
        lines, ",", header, tuple(row for row in lines.content if "northing [m]" not in row[1])
    )
    position = np.stack(
        [table.column(name) for name in ("northing [m]", "easting [m]", "depth [m]")], axis=-1
    )
    angles = np.radians(
        [table.column(name) for name in ("roll [deg]", "pitch [deg]", "heading [deg]")]
    )
    R_ned_vehicle = rotation_from_euler(*angles)
    origin = _origin(table, position, R_ned_vehicle, mount)
    T = poses_from_ned(R_ned_vehicle @ mount_rotation(mount), position)
    times = np.array(table.column("timestamp [s]", np.nan))
    return Trajectory(tuple(table.text("relative_path")), times, T, origin=origin, camera="raw")


def _origin(
    table: Table, camera_ned: np.ndarray, R_ned_vehicle: np.ndarray, mount: MountConfig
) -> GeoOrigin | None:
    """The origin of northing and easting: latitude and longitude are the vehicle's center."""
    latitude = np.array(table.column("latitude [deg]", np.nan))
    longitude = np.array(table.column("longitude [deg]", np.nan))
    vehicle_ned = camera_ned - R_ned_vehicle @ mount_offset_m(mount)
    return origin_of(latitude, longitude, vehicle_ned[:, :2])


FORMAT = TextFormat("oplab", recognizes, read)
