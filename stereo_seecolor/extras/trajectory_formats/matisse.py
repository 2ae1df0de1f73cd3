"""Matisse: navigation as CSV with a header, and ``;``-separated dim2; the vehicle's position and
attitude.
"""

import re

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.inputs.trajectories.table import Lines, Table, is_number
from stereo_seecolor.inputs.trajectories.times import TimeError, column_seconds
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.inputs.trajectories.vehicle_track import VehicleTrack, from_degrees, step_of
from stereo_seecolor.records import Trajectory

_NEEDED = ("date", "time", "latitude", "longitude", "depth", "heading", "pitch", "roll")
_DIM2 = ["dive", "date", "time", "source", "format", "filename", "latitude", "longitude"]
_DIM2 += ["depth", "altitude", "heading", "roll", "pitch"]


def recognizes(lines: Lines) -> bool:
    """A header with date, time, place and attitude, or 13 fields and more between semicolons.
    ORCA's header names images.
    """
    header = set(_header(lines))
    return _is_dim2(lines) or (header.issuperset(_NEEDED) and "image_name" not in header)


def read(lines: Lines, mount: MountConfig) -> Trajectory:
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
    fields = lines.first.split(";")
    return len(fields) >= len(_DIM2) and all(map(is_number, fields[6:8]))


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


FORMAT = TextFormat("Matisse", recognizes, read)
