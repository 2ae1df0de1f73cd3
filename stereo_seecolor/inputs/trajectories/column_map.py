"""Any table of navigation, with a map of its columns: ``nav.csv:time=UTC,lat=Latitude,lon=Longitude,depth=Depth,heading=Hdg``."""

import difflib
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.table import Lines, Table
from stereo_seecolor.inputs.trajectories.times import date_and_time, seconds
from stereo_seecolor.inputs.trajectories.vehicle import Column, VehicleTrack, from_degrees
from stereo_seecolor.records import GeoOrigin, Trajectory

ROLES = {
    "name": "the image's file name",
    "time": "seconds since 1970 (or ms, us, ns), or ISO 8601; with date, h:m:s",
    "date": "d/m/Y or Y/m/d, where time is h:m:s",
    "lat": "degrees",
    "lon": "degrees",
    "north": "meters, instead of lat",
    "east": "meters, instead of lon",
    "depth": "meters below the surface",
    "up": "meters above it, instead of depth",
    "heading": "degrees clockwise from north",
    "pitch": "degrees, bow up; 0 where absent",
    "roll": "degrees, starboard down; 0 where absent",
}
_PLACE = "lat and lon (or north and east)"
_ANGLES = {"lat", "lon", "heading", "pitch", "roll"}
_NEEDED = {
    _PLACE: ({"lat", "lon"}, {"north", "east"}),
    "depth (or up)": ({"depth"}, {"up"}),
    "heading": ({"heading"},),
    "time (or name)": ({"time"}, {"name"}),
}
_FIXES = {"name", "time", "date", "lat", "lon", "north", "east"}
"""A map of these alone is of positions without depth and attitude: a buoy's fixes."""
_NAMES = {
    "name": "name|file|file_?name|image|image_?name|photo",
    "time": "time|time_?stamp|utc|utc_?time|gps_?time|date_?time|unix_?time|epoch|zeit",
    "lat": "lat|latitude|breite",
    "lon": "lon|long|lng|longitude|laenge|länge",
    "north": "north|northing",
    "east": "east|easting",
    "depth": "depth|vehicle_?depth|water_?depth|tiefe|profondeur|profundidad",
    "heading": "heading|hdg|yaw|kurs|cap|rumbo",
    "pitch": "pitch",
    "roll": "roll",
}
"""Role -> usual names of its column, before a unit. Altitude is none of them: vehicles measure it above the bottom."""
_UNIT = re.compile(r"([ _]*(\(.*?\)|\[.*?\])|[ _]+(deg|degrees|rad|radians|m|s))?$")
_RADIANS = re.compile(r"[ _(\[]rad(ians)?[)\]]?$")
_EXAMPLE = "nav.csv:time=UTC,lat=Latitude,lon=Longitude,depth=Depth,heading=Heading"
_SPEC = re.compile(r"(?P<file>.+?):(?P<columns>\w+=.*)")
_SEPARATORS = (",", ";", "\t")


def split_spec(spec: Path) -> tuple[Path, dict[str, str]]:
    """The file, and role -> column name. A path without a map has none.

    Raises InputError for a role that does not exist or is given twice.
    """
    match = _SPEC.fullmatch(str(spec))
    if match is None or spec.exists():
        return spec, {}
    columns: dict[str, str] = {}
    for part in match["columns"].split(","):
        role, _, column = (text.strip() for text in part.partition("="))
        if role not in ROLES or not column or role in columns:
            known = ", ".join(ROLES)
            raise InputError(f"{spec}: {part!r} is no role=column with a role of its own ({known}): write {_EXAMPLE}")
        columns[role] = column
    return Path(match["file"]), columns


def recognizes(lines: Lines) -> bool:
    """A header whose names tell a place, and a time or an image."""
    columns = _guessed(lines)
    return bool({"lat", "lon"} <= columns.keys() or {"north", "east"} <= columns.keys()) and bool({"time", "name"} & columns.keys())


def read_by_names(lines: Lines, mount: MountConfig) -> Trajectory:
    """Read a table as ``read`` does, by the usual names of columns."""
    return read(lines, _guessed(lines), mount)


def _guessed(lines: Lines) -> dict[str, str]:
    """Role -> the first column of a usual name for it."""
    found: dict[str, str] = {}
    for name in _header(lines)[1]:
        bare = _UNIT.sub("", name)
        role = next((role for role, names in _NAMES.items() if role not in found and re.fullmatch(names, bare)), None)
        if role:
            found[role] = name
    return found


def read(lines: Lines, columns: Mapping[str, str], mount: MountConfig) -> Trajectory:
    """The camera's poses from the vehicle's; places alone are ``fixes``. columns: role (see ROLES) -> column.

    Raises InputError for what is missing.
    """
    _check_roles(lines, columns)
    table = _table(lines, columns)
    origin: GeoOrigin | None = None
    north_east_m = np.column_stack([_numbers(table, columns, "north"), _numbers(table, columns, "east")])
    if "lat" in columns:
        latitude_deg = _numbers(table, columns, "lat")
        if (np.abs(latitude_deg) > 90).any():
            most = f"latitudes reach {np.nanmax(np.abs(latitude_deg)):.6g} degrees"
            raise InputError(f"{lines.path}: {most}: are latitude and longitude exchanged, or meters or minutes in that column?")
        north_east_m, origin = from_degrees(latitude_deg, _numbers(table, columns, "lon"))
    depth_m = _numbers(table, columns, "depth") if "depth" in columns else -_numbers(table, columns, "up")
    mount = MountConfig() if columns.keys() <= _FIXES else mount
    attitude_deg = np.column_stack([_numbers(table, columns, role) for role in ("roll", "pitch", "heading")])
    names = tuple(table.text(columns["name"].lower()) if "name" in columns else [""] * len(table.rows))
    track = VehicleTrack(names, _times(table, columns), north_east_m, depth_m, attitude_deg, origin).camera(mount)
    return replace(track, fixes=columns.keys() <= _FIXES)


def _check_roles(lines: Lines, columns: Mapping[str, str]) -> None:
    missing = [what for what, choices in _NEEDED.items() if not any(choice <= columns.keys() for choice in choices)]
    if columns.keys() <= _FIXES and "time" in columns and _PLACE not in missing:
        return
    if missing:
        raise InputError(f"{lines.path}: the column map lacks {', '.join(missing)}: write {_EXAMPLE}")


def _table(lines: Lines, columns: Mapping[str, str]) -> Table:
    """The header is the first line, also where it begins with ``#`` or ``%``."""
    separator, header = _header(lines)
    for role, column in columns.items():
        if column.lower() not in header:
            near = difflib.get_close_matches(column.lower(), header, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(header)[:200]}"
            raise InputError(f"{lines.path}: has no column {column!r} for {role}; {hint}")
    rows = tuple(row for row in lines.content if row[1].lstrip("#% ") != lines.header)
    return Table.read(lines, separator, header, rows)


def _header(lines: Lines) -> tuple[str, list[str]]:
    """What separates columns, and their names in lower case."""
    separator = max(_SEPARATORS, key=lines.header.count)
    return separator, [name.strip().strip('"').lower() for name in lines.header.split(separator)]


def _numbers(table: Table, columns: Mapping[str, str], role: str) -> Column:
    """A role's column, of angles in degrees, also where its name says radians; zeros where the map does not name one."""
    if role not in columns:
        return np.zeros(len(table.rows))
    values = np.array(table.column(columns[role].lower()))
    return np.degrees(values) if role in _ANGLES and _RADIANS.search(columns[role].lower()) else values


def _times(table: Table, columns: Mapping[str, str]) -> Column:
    if "time" not in columns:
        return np.full(len(table.rows), np.nan)
    dates = table.text(columns["date"].lower()) if "date" in columns else [""] * len(table.rows)
    times = table.text(columns["time"].lower())
    return np.array([_seconds(table, i, date, time) for i, (date, time) in enumerate(zip(dates, times, strict=True))])


def _seconds(table: Table, row: int, date: str, time: str) -> float:
    try:
        return date_and_time(date, time) if date else seconds(time)
    except (ValueError, OverflowError) as error:
        raise table.lines.error(table.rows[row][0], f"no time in {f'{date} {time}'.strip()!r}: {ROLES['time']}") from error
