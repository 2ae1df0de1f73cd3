"""Navigation's axes to the map's: north-east-down to east-north-up, Euler angles, degrees on Earth to meters."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereo_seecolor.config import MountConfig
from stereo_seecolor.records import GeoOrigin

R_ENU_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])

_SEMI_MAJOR_M = 6378137.0
_ECCENTRICITY_SQUARED = 0.00669437999014


def rotation_from_euler(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> NDArray[np.float64]:
    """Rz(yaw) Ry(pitch) Rx(roll), radians, shape (..., 3, 3): body axes to the axes the angles are measured in."""
    r, p, y = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (roll, pitch, yaw)))
    sr, cr, sp, cp, sy, cy = np.sin(r), np.cos(r), np.sin(p), np.cos(p), np.sin(y), np.cos(y)
    rows = [
        np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], axis=-1),
        np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], axis=-1),
        np.stack([-sp, cp * sr, cp * cr], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def rotation_from_quaternion(quaternion: ArrayLike) -> NDArray[np.float64]:
    """(N, 4) as x, y, z, w -> (N, 3, 3); normalized first, NaN for a zero quaternion."""
    q = np.atleast_2d(np.asarray(quaternion, dtype=np.float64))
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def poses(R: NDArray[np.float64], position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4, 4) from rotations (N, 3, 3) and positions (N, 3)."""
    T = np.tile(np.eye(4), (len(position_m), 1, 1))
    T[:, :3, :3] = R
    T[:, :3, 3] = position_m
    return T


def poses_from_ned(R_ned_camera: NDArray[np.float64], position_ned_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Camera poses in north-east-down to camera poses in east-north-up, (N, 4, 4)."""
    return poses(R_ENU_NED @ R_ned_camera, position_ned_m @ R_ENU_NED.T)


def mount_rotation(mount: MountConfig) -> NDArray[np.float64]:
    """(3, 3): camera axes to vehicle axes."""
    return rotation_from_euler(*np.radians([mount.roll_deg, mount.pitch_deg, mount.yaw_deg]))


def mount_offset_m(mount: MountConfig) -> NDArray[np.float64]:
    """(3,): the camera in vehicle axes."""
    return np.array([mount.surge_m, mount.sway_m, mount.heave_m])


def north_east_from_degrees(latitude_deg: ArrayLike, longitude_deg: ArrayLike, origin: GeoOrigin) -> NDArray[np.float64]:
    """(N, 2) meters north and east of the origin: transverse Mercator at the origin, to second order in longitude.

    Snyder, Map Projections (USGS 1395), eqs. 8-9 and 8-10; within 1 mm of the full projection over a kilometer.
    """
    latitude, longitude = np.radians(np.asarray(latitude_deg, np.float64)), np.asarray(longitude_deg, np.float64)
    latitude_0 = np.radians(origin.latitude_deg)
    d_longitude = np.radians((longitude - origin.longitude_deg + 180) % 360 - 180)
    meridian_m = _SEMI_MAJOR_M * (1 - _ECCENTRICITY_SQUARED) / _flattened((latitude + latitude_0) / 2) ** 1.5
    prime_vertical_m = _SEMI_MAJOR_M / np.sqrt(_flattened(latitude))
    east = prime_vertical_m * np.cos(latitude) * d_longitude
    north = (latitude - latitude_0) * meridian_m + east * np.sin(latitude) * d_longitude / 2
    return np.stack([north, east], axis=-1)


def _flattened(latitude: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
