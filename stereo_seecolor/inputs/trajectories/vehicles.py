"""Trajectories of vehicles' own programs: ACFR, oplab, ORCA, Matisse."""

import re

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import north_east_from_degrees
from stereo_seecolor.inputs.trajectories.axes import (
    VehicleTrack,
    from_degrees,
    mount_offset_m,
    mount_rotation,
    poses_from_ned,
    rotation_from_euler,
    step_of,
)
from stereo_seecolor.inputs.trajectories.table import (
    Lines,
    Table,
    TimeError,
    column_seconds,
    is_number,
    seconds,
)
from stereo_seecolor.records import GeoOrigin, Trajectory

# ACFR stereo_pose_est.data: pose of the left camera in north-east-down, Euler angles in radians,
# with both image names.

_WITH_DEGREES = 15  # columns of a pose with latitude and longitude
_WITHOUT_DEGREES = 13  # columns of one without


def is_acfr(lines: Lines) -> bool:
    """The first line's comment, or 13 or 15 columns with two names in them."""
    return "STEREO_POSE_FILE" in " ".join(lines.all[:3]) or _is_pose(
        lines.content[-1][1].split() if lines.content else []
    )


def _is_pose(fields: list[str]) -> bool:
    """Five points of an image in a COLMAP file are 15 columns too, but all of them numbers."""
    names = {_WITH_DEGREES: fields[10:12], _WITHOUT_DEGREES: fields[8:10]}.get(len(fields), [])
    return bool(names) and not any(is_number(name) for name in names)


def read_acfr(lines: Lines, mount: MountConfig) -> Trajectory:
    """The angles are the raw camera's own (x right, y down, z along the optical axis): no mount is
    needed.
    """
    origin, rows = _origin_acfr(lines)
    values, names = [], []
    for number, line in rows:
        fields = line.split()
        if len(fields) not in (_WITH_DEGREES, _WITHOUT_DEGREES):
            raise lines.error(
                number, f"a stereo pose has {_WITH_DEGREES} columns, got {len(fields)}"
            )
        first = 4 if len(fields) == _WITH_DEGREES else 2
        values.append(lines.numbers(number, [fields[1], *fields[first : first + 6]]))
        names.append(fields[first + 6])
    table = np.reshape(values, (-1, 7))
    T = poses_from_ned(rotation_from_euler(table[:, 4], table[:, 5], table[:, 6]), table[:, 1:4])
    return Trajectory(tuple(names), table[:, 0], T, origin=origin, camera="raw")


def _origin_acfr(lines: Lines) -> tuple[GeoOrigin | None, tuple[tuple[int, str], ...]]:
    """The first two lines hold latitude and longitude, bare or after ORIGIN_LATITUDE and
    ORIGIN_LONGITUDE.
    """
    head = [(number, line.split()) for number, line in lines.content[:2]]
    if len(head) < 2 or any(len(fields) > 2 for _, fields in head):
        return None, lines.content
    latitude, longitude = (lines.numbers(number, fields[-1:])[0] for number, fields in head)
    return GeoOrigin(latitude, longitude), lines.content[2:]


# oplab's auv_ekf_<camera>.csv and auv_dr_<camera>.csv: the camera's position, but the VEHICLE's
# roll, pitch and heading.


def is_oplab(lines: Lines) -> bool:
    """The header oplab writes, with or without its ``#``."""
    return "northing [m]" in lines.all[0] and "relative_path" in lines.all[0]


def read_oplab(lines: Lines, mount: MountConfig) -> Trajectory:
    """Position from northing, easting, depth (the camera's); attitude from the vehicle's angles and
    the mount's.
    """
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
    origin = _origin_oplab(table, position, R_ned_vehicle, mount)
    T = poses_from_ned(R_ned_vehicle @ mount_rotation(mount), position)
    times = np.array(table.column("timestamp [s]", np.nan))
    return Trajectory(tuple(table.text("relative_path")), times, T, origin=origin, camera="raw")


def _origin_oplab(
    table: Table, camera_ned: np.ndarray, R_ned_vehicle: np.ndarray, mount: MountConfig
) -> GeoOrigin | None:
    """The origin that northing and easting count from: latitude and longitude are the vehicle's
    center's.
    """
    latitude = np.array(table.column("latitude [deg]", np.nan))
    longitude = np.array(table.column("longitude [deg]", np.nan))
    vehicle_ned = camera_ned - R_ned_vehicle @ mount_offset_m(mount)
    known = np.flatnonzero(
        np.isfinite(latitude) & np.isfinite(longitude) & np.isfinite(vehicle_ned).all(axis=1)
    )
    if not known.size:
        return None
    first = known[0]
    anchor = GeoOrigin(latitude[first], longitude[first])
    meters = north_east_from_degrees([latitude[first] + 0.001], [longitude[first] + 0.001], anchor)[
        0
    ]
    shift = vehicle_ned[first, :2] / meters * 0.001
    return GeoOrigin(float(latitude[first] - shift[0]), float(longitude[first] - shift[1]))


# ORCA processed_images.csv:
# ``image_name,image_path,timestamp_utc,latitude,longitude,heading_deg,depth_m``.


def is_orca(lines: Lines) -> bool:
    """A header with image_name and latitude."""
    header = lines.first.lower().split(",")
    return "image_name" in header and "latitude" in header


def read_orca(lines: Lines, mount: MountConfig) -> Trajectory:
    """A level vehicle; a depth of zero or less is unknown, and a frame without depth or heading has
    no pose.
    """
    header = [name.strip().lower() for name in lines.first.split(",")]
    table = Table.read(lines, ",", header, lines.content[1:])
    depth_m = np.array(table.column("depth_m", np.nan))
    attitude_deg = np.zeros((len(table.rows), 3))
    attitude_deg[:, 2] = table.column("heading_deg", np.nan)
    north_east_m, origin = from_degrees(
        np.array(table.column("latitude")), np.array(table.column("longitude"))
    )
    times = np.array([_seconds_or_nan(text) for text in table.text("timestamp_utc")])
    depth_m = np.where(depth_m > 0, depth_m, np.nan)
    names, step_m = tuple(table.text("image_name")), step_of(table.text("latitude"))
    return VehicleTrack(names, times, north_east_m, depth_m, attitude_deg, origin, step_m).camera(
        mount
    )


def _seconds_or_nan(text: str) -> float:
    try:
        return seconds(text)
    except ValueError:
        return float("nan")


# Matisse: navigation CSV with a header, and ``;``-separated dim2; the vehicle's position and
# attitude.

_NEEDED = ("date", "time", "latitude", "longitude", "depth", "heading", "pitch", "roll")
_DIM2 = ["dive", "date", "time", "source", "format", "filename", "latitude", "longitude"]
_DIM2 += ["depth", "altitude", "heading", "roll", "pitch"]


def is_matisse(lines: Lines) -> bool:
    """A header with date, time and latitude, or 13 fields and more between semicolons."""
    return _is_dim2(lines) or {"date", "time", "latitude", "heading"} <= set(_header(lines))


def read_matisse(lines: Lines, mount: MountConfig) -> Trajectory:
    """Times are UTC. dim2 gives heading, then ROLL, then pitch; the CSV's order is its header's."""
    if _is_dim2(lines):
        table = Table.read(lines, ";", _DIM2, lines.content)
    else:
        header = _header(lines)
        rows = tuple(row for row in lines.content if not row[1].lower().startswith("date"))
        table = Table.read(lines, ",", header, rows)
    times = _seconds(lines, table)
    latitude, longitude, depth_m, heading, pitch, roll = (
        np.array(table.column(name)) for name in _NEEDED[2:]
    )
    attitude_deg = np.stack([roll, pitch, heading], axis=-1)
    north_east_m, origin = from_degrees(latitude, longitude)
    names, step_m = tuple(table.text("filename")), step_of(table.text("latitude"))
    return VehicleTrack(
        names, np.array(times), north_east_m, np.abs(depth_m), attitude_deg, origin, step_m
    ).camera(mount)


def _is_dim2(lines: Lines) -> bool:
    return lines.first.count(";") >= len(_DIM2) - 1


def _header(lines: Lines) -> list[str]:
    """``##date_dd/MM/yyyy,time,...`` or ``DATE,TIME,...``: the names without the hash and the
    date's pattern.
    """
    names = [name.strip().lower() for name in lines.all[0].lstrip("# ").split(",")]
    return [re.sub(r"^date_.*$", "date", name) for name in names]


def _seconds(lines: Lines, table: Table) -> list[float]:
    """The day before the month where the dates tell nothing else, and the header's pattern of the
    date names no other order.
    """
    pattern = lines.all[0].lower().partition("date_")[2]
    month_first = 0 <= pattern.find("mm") < pattern.find("dd") and not pattern.startswith("y")
    try:
        return column_seconds(
            [f"{row['date']} {row['time']}" for _, row in table.rows], day_first=not month_first
        )
    except TimeError as error:
        number, row = table.rows[error.row]
        raise lines.error(
            number,
            f"no date and time in {row['date']!r}, {row['time']!r}: write d/m/Y or Y/m/d and h:m:s",
        ) from error
