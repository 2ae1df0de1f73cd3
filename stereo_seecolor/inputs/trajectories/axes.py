"""Axes of navigation and of the map, and the camera's poses from the vehicle's."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import north_east_from_degrees
from stereo_seecolor.geometry import pose
from stereo_seecolor.records import GeoOrigin, Trajectory

# Conversion of navigation's axes to the map's: north-east-down to east-north-up, Euler angles.

R_ENU_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


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
    return pose(R_ENU_NED @ R_ned_camera, position_ned_m @ R_ENU_NED.T)


def mount_rotation(mount: MountConfig) -> NDArray[np.float64]:
    """The rotation from camera axes to vehicle axes: (3, 3)."""
    return rotation_from_euler(*np.radians(mount.rpy_deg))


def mount_offset_m(mount: MountConfig) -> NDArray[np.float64]:
    """The position of the camera in vehicle axes: (3,)."""
    return np.array(mount.xyz_m)


# The camera's poses in the map from the vehicle's.

Column = NDArray[np.float64]
"""(N,) float64, NaN = unknown."""


@dataclass(frozen=True, eq=False)
class VehicleTrack:
    """Navigation of a vehicle, N rows; what is NaN gives a NaN pose.

    names: of the images, "" where none is named. timestamps_s: (N,) seconds since 1970.
    north_east_m: (N, 2) from the origin.
    depth_m: (N,) below the surface. attitude_deg: (N, 3) roll, pitch, heading. origin: None for a
    local map. position_step_m: what positions are rounded to.
    """

    names: tuple[str, ...]
    timestamps_s: Column
    north_east_m: NDArray[np.float64]
    depth_m: Column
    attitude_deg: NDArray[np.float64]
    origin: GeoOrigin | None = None
    position_step_m: float = 0.0

    def camera(self, mount: MountConfig) -> Trajectory:
        """The raw camera's poses in east-north-up, z zero at the water's surface."""
        R_ned_vehicle = rotation_from_euler(*np.radians(self.attitude_deg.T))
        position = np.column_stack(
            [self.north_east_m, self.depth_m]
        ) + R_ned_vehicle @ mount_offset_m(mount)
        T = poses_from_ned(R_ned_vehicle @ mount_rotation(mount), position)
        return Trajectory(
            self.names,
            self.timestamps_s,
            T,
            origin=self.origin,
            camera="raw",
            position_step_m=self.position_step_m,
        )


METERS_PER_DEGREE = 111_000.0
"""Of latitude."""


def step_of(latitudes: Sequence[str]) -> float:
    """What degrees are rounded to: one of the last digit that any of them has.

    Args:
        latitudes: As written: ``14.685`` or ``14 41.10``.

    Returns:
        The step, meters; 0 without numbers.
    """
    parts = [re.findall(r"\d+(?:\.\d+)?", text) for text in latitudes if "e" not in text.lower()]
    digits = [(len(p), len(p[-1].partition(".")[2])) for p in parts if p]
    if not digits:
        return 0.0
    return float(METERS_PER_DEGREE * min(60.0 ** (1 - n) * 10.0**-d for n, d in digits))


def from_degrees(
    latitude_deg: Column, longitude_deg: Column
) -> tuple[NDArray[np.float64], GeoOrigin]:
    """Convert to meters north and east of the first known position, (N, 2); and that position."""
    known = np.flatnonzero(np.isfinite(latitude_deg) & np.isfinite(longitude_deg))
    first = int(known[0]) if known.size else 0
    origin = GeoOrigin(float(latitude_deg[first]), float(longitude_deg[first]))
    return north_east_from_degrees(latitude_deg, longitude_deg, origin), origin
