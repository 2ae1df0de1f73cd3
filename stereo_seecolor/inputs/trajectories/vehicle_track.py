"""The camera's poses in the map from the vehicle's."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.transforms import rigid_transform, rotation_from_euler
from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import north_east_from_degrees
from stereo_seecolor.inputs.trajectories.axes import (
    mount_offset_m,
    mount_rotation,
    poses_from_ned,
)
from stereo_seecolor.records import Array, GeoOrigin, Trajectory

Column = Array
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
    north_east_m: Array
    depth_m: Column
    attitude_deg: Array
    origin: GeoOrigin | None = None
    position_step_m: float = 0.0

    def camera(self, mount: MountConfig) -> Trajectory:
        """The raw camera's poses in east-north-up, z zero at the water's surface."""
        R_ned_vehicle = rotation_from_euler(*np.radians(self.attitude_deg.T))
        T_vehicle_camera = rigid_transform(mount_rotation(mount), mount_offset_m(mount))
        place = np.column_stack([self.north_east_m, self.depth_m])
        T_ned = rigid_transform(R_ned_vehicle, place) @ T_vehicle_camera
        T = poses_from_ned(T_ned[:, :3, :3], T_ned[:, :3, 3])
        return Trajectory(
            self.names,
            self.timestamps_s,
            T,
            origin=self.origin,
            camera="raw",
            position_step_m=self.position_step_m,
            T_vehicle_camera=T_vehicle_camera,
        )


METERS_PER_DEGREE = 111_000.0
"""Of latitude."""


def step_of(cells: Sequence[str], unit_m: float = METERS_PER_DEGREE) -> float:
    """What numbers as written (``14.685``, ``14 41.10``) are rounded to, meters: one of the last
    digit that any of them has; 0 without numbers. unit_m: meters a unit of the first number.
    """
    parts = [re.findall(r"\d+(?:\.\d+)?", text) for text in cells if "e" not in text.lower()]
    digits = [(len(p), len(p[-1].partition(".")[2])) for p in parts if p]
    if not digits:
        return 0.0
    return float(unit_m * min(60.0 ** (1 - n) * 10.0**-d for n, d in digits))


def from_degrees(latitude_deg: Column, longitude_deg: Column) -> tuple[Array, GeoOrigin]:
    """Convert to meters north and east of the first known position, (N, 2); and that position."""
    known = np.flatnonzero(np.isfinite(latitude_deg) & np.isfinite(longitude_deg))
    first = int(known[0]) if known.size else 0
    origin = GeoOrigin(float(latitude_deg[first]), float(longitude_deg[first]))
    return north_east_from_degrees(latitude_deg, longitude_deg, origin), origin


def origin_of(latitude_deg: Column, longitude_deg: Column, north_east_m: Array) -> GeoOrigin | None:
    """Where the origin of north and east (N, 2) lies, by the first row that is known in both; None
    without one.
    """
    known = np.isfinite(latitude_deg) & np.isfinite(longitude_deg)
    known &= np.isfinite(north_east_m).all(axis=1)
    if not known.any():
        return None
    first = int(np.argmax(known))
    latitude, longitude = float(latitude_deg[first]), float(longitude_deg[first])
    place = GeoOrigin(latitude, longitude)
    meters = north_east_from_degrees([latitude + 0.001], [longitude + 0.001], place)[0]
    shift = north_east_m[first] / meters * 0.001
    return GeoOrigin(float(latitude - shift[0]), float(longitude - shift[1]))
