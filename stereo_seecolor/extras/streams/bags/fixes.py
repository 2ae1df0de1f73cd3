"""The track of a vehicle without odometry: satellite fixes, the attitude of its IMU, and the depth
of its pressure sensor.

Axes are those of REP 103 and REP 145: attitude turns the body (forward, left, up) to the world
(east, north, up).
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import rigid_transform, rotation_from_quaternion
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.bag import FIX, IMU, PRESSURE, Bag, Entry
from stereo_seecolor.extras.streams.bags.messages import decode
from stereo_seecolor.inputs.trajectories.vehicle_track import from_degrees
from stereo_seecolor.records import Array, GeoOrigin


@dataclass(frozen=True)
class FixConstants:
    """Decides what is a position, and how pressure becomes depth."""

    most: int = 20_000  # of more fixes every second one is taken, or fewer: poses are interpolated
    reach_s: float = 0.5  # a fix without attitude or pressure so near has none
    # standard atmosphere: the weather changes it by 2%, 0.2 m of water
    surface_pa: float = 101_325.0
    pa_m: float = 1025.0 * 9.81  # pressure of a meter of sea water of 15 degrees


CONSTANTS = FixConstants()


@dataclass(frozen=True, eq=False)
class FixedTrack:
    """The track of the antenna. times_s: (N,). T_world_body: (N, 4, 4), turned as the IMU; world
    east-north-up from ``origin``, z = -depth.

    fix_frame, imu_frame: what the two are called in the transforms.
    """

    times_s: Array
    T_world_body: Array
    origin: GeoOrigin
    fix_frame: str
    imu_frame: str


def fixed_track(bag: Bag) -> FixedTrack | None:
    """The track of the longest topic of fixes; None for a bag that has none.

    Raises InputError where no attitude goes with the fixes, or a message is damaged; DeviceError if
    a library is missing.
    """
    fixes, imu = _longest(bag, FIX), _longest(bag, IMU)
    read = ((entry, decode(entry)) for entry in fixes[:: -(-len(fixes) // CONSTANTS.most) or 1])
    known = [(entry, message) for entry, message in read if _is_fix(message)]
    if not known:
        return None
    if not imu or decode(imu[0]).orientation_covariance[0] == -1:
        raise InputError(
            f"{bag.path}: contains satellite fixes but no attitude: no Imu message with an "
            "orientation matches them in time"
        )
    times_ns = np.array([entry.stamp_ns for entry, _ in known])
    north_east_m, origin = from_degrees(
        np.array([message.latitude for _, message in known]),
        np.array([message.longitude for _, message in known]),
    )
    depth_m = _depth_m(
        bag, times_ns, np.array([message.altitude for _, message in known], np.float64)
    )
    origin = replace(origin, depth_known=bool(_longest(bag, PRESSURE)))
    T = rigid_transform(
        _attitude(imu, times_ns), np.column_stack([north_east_m[:, ::-1], -depth_m])
    )
    frames = (decode(entry).header.frame_id.lstrip("/") for entry in (fixes[0], imu[0]))
    return FixedTrack(times_ns / 1e9, T, origin, *frames)


def _is_fix(message: object) -> bool:
    """The receiver says that it has one, and it is on Earth."""
    status, latitude, longitude = (message.status.status, message.latitude, message.longitude)  # type: ignore[attr-defined]
    return bool(status >= 0 and abs(latitude) <= 90 and abs(longitude) <= 360)


def _longest(bag: Bag, msgtype: str) -> tuple[Entry, ...]:
    return max(
        (topic.entries for topic in bag.topics if topic.msgtype == msgtype), key=len, default=()
    )


def _attitude(entries: Sequence[Entry], times_ns: NDArray[np.int64]) -> Array:
    """(N, 3, 3) turned from one message to the next; NaN where none is near."""
    from scipy.spatial.transform import Rotation, Slerp

    near = _around(entries, times_ns)
    stamps = np.array([entry.stamp_ns for entry in near], np.float64)
    quaternions = [decode(entry).orientation for entry in near]
    R = rotation_from_quaternion(np.array([(q.x, q.y, q.z, q.w) for q in quaternions]))
    finite = np.isfinite(R).all(axis=(1, 2))
    found = np.full((len(times_ns), 3, 3), np.nan)
    if finite.sum() < 2:
        return found
    stamps, R = stamps[finite], R[finite]
    at = np.clip(times_ns.astype(np.float64), stamps[0], stamps[-1])
    is_near = np.abs(times_ns - stamps[_nearest(stamps, times_ns)]) <= CONSTANTS.reach_s * 1e9
    found[is_near] = Slerp(stamps - stamps[0], Rotation.from_matrix(R))(
        at[is_near] - stamps[0]
    ).as_matrix()
    return found


def _depth_m(bag: Bag, times_ns: NDArray[np.int64], altitude_m: Array) -> Array:
    """By pressure if the bag holds it; else below the first fix by heights; else 0."""
    entries = _longest(bag, PRESSURE)
    if not entries:
        first = altitude_m[np.isfinite(altitude_m)]
        return (
            np.where(np.isfinite(altitude_m), first[0] - altitude_m, 0.0)
            if first.size
            else np.zeros(len(times_ns))
        )
    near = _around(entries, times_ns)
    stamps = np.array([entry.stamp_ns for entry in near], np.float64)
    pressure = np.array([decode(entry).fluid_pressure for entry in near])
    is_near = np.abs(times_ns - stamps[_nearest(stamps, times_ns)]) <= CONSTANTS.reach_s * 1e9
    depth_m = (np.interp(times_ns, stamps, pressure) - CONSTANTS.surface_pa) / CONSTANTS.pa_m
    return np.where(is_near, depth_m, np.nan)


def _around(entries: Sequence[Entry], times_ns: NDArray[np.int64]) -> list[Entry]:
    """The messages before and after each time, each once, by their stamps."""
    stamps = [entry.stamp_ns for entry in entries]
    wanted = {
        at
        for time_ns in times_ns
        for at in (bisect_left(stamps, time_ns) - 1, bisect_left(stamps, time_ns))
    }
    chosen = [entries[at] for at in sorted(wanted) if 0 <= at < len(entries)]
    return [
        entry
        for at, entry in enumerate(chosen)
        if at == 0 or entry.stamp_ns > chosen[at - 1].stamp_ns
    ]


def _nearest(stamps: Array, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    after = (
        np.clip(np.searchsorted(stamps, times_ns), 1, max(len(stamps) - 1, 1))
        if len(stamps) > 1
        else np.zeros(len(times_ns), int)
    )
    before = np.maximum(after - 1, 0)
    return np.where(
        np.abs(stamps[before] - times_ns) <= np.abs(stamps[after] - times_ns), before, after
    )
