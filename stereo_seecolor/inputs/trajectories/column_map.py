"""Any table of navigation, with a map of its columns:
``nav.csv:time=UTC,lat=Latitude,lon=Longitude,depth=Depth,heading=Hdg``.
"""

import csv
import difflib
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.csv_tables import separator_of, split_fields
from stereo_seecolor.inputs.trajectories.columns import roles_of, unit, words
from stereo_seecolor.inputs.trajectories.degrees import OF_MAVLINK, read_degrees
from stereo_seecolor.inputs.trajectories.held_fixes import MAX_GAP_S, HeldFixes, between_fixes
from stereo_seecolor.inputs.trajectories.table import Lines, Table, is_number
from stereo_seecolor.inputs.trajectories.times import (
    AmbiguousDateError,
    TimeError,
    column_seconds,
    is_unknown,
)
from stereo_seecolor.inputs.trajectories.vehicle_track import (
    METERS_PER_DEGREE,
    Column,
    VehicleTrack,
    from_degrees,
    step_of,
)
from stereo_seecolor.records import Mask, Trajectory

ROLES = {
    "name": "the image's file name",
    "time": "seconds since 1970 (or ms, us, ns), or ISO 8601; with date or us_date, h:m:s",
    "date": "d/m/Y or Y/m/d, where time is h:m:s",
    "us_date": "m/d/Y, where time is h:m:s",
    "lat": "degrees, also as 14 41.1 S",
    "lon": "degrees",
    "north": "meters, instead of lat",
    "east": "meters, instead of lon",
    "depth": "meters below the surface; mostly negative: meters above it",
    "up": "meters above it, instead of depth",
    "heading": "degrees clockwise from north",
    "pitch": "degrees, bow up; default 0",
    "roll": "degrees, starboard down; default 0",
    "valid": "false or 0 if the position is unknown",
}
_PLACE = "lat and lon (or north and east)"
_ANGLES = {"lat", "lon", "heading", "pitch", "roll"}
_NEEDED = {
    _PLACE: ({"lat", "lon"}, {"north", "east"}),
    "depth (or up)": ({"depth"}, {"up"}),
    "heading": ({"heading"},),
    "time (or name)": ({"time"}, {"name"}),
}
_FIXES = {"name", "time", "date", "us_date", "lat", "lon", "north", "east", "valid"}
"""A map of these alone is of positions without depth and attitude: a buoy's fixes."""
_NOT_VALID = {"false", "0", "0.0", "no", "v", "invalid"}
_NO_VALUE = (-999.0, -9999.0, -99999.0)
_EXAMPLE = "nav.csv:time=UTC,lat=Latitude,lon=Longitude,depth=Depth,heading=Heading"
_SPEC = re.compile(r"(?P<file>.+?):(?P<columns>\w+=.*)")
_CLOCK = re.compile(r"\d{1,2}:\d")
"""A time of day, as h:m:s."""
SINCE_EPOCH = 1e8
"""Seconds from here on are since 1970: since midnight they would be three years."""
_WITH_CLOCK = re.compile(r"\d[ T]\d{1,2}:\d\d")
"""In a date with a time of day."""
_HEIGHTS = {"alt", "altitude", "height", "elevation"}
LEAST_COLUMNS = 4
"""Of a table: time, and a position or attitude in three."""
UNKNOWN_HEADING, _MESSAGE, _ATTITUDE = 65535, "global_position_int", "attitude."
"""Of MAVLink."""


def split_files(spec: Path) -> list[Path]:
    """Split the files of ``position.csv,attitude.csv``, each with its map of columns if any."""
    files: list[str] = []
    for part in [str(spec)] if spec.exists() else str(spec).split(","):
        if files and ("=" in part.partition(":")[0] or "." not in part):
            files[-1] += f",{part}"
        else:
            files.append(part.strip())
    return [Path(file) for file in files]


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
            raise InputError(
                f"{spec}: {part!r} is not a role=column with a known, unused role ({known}): "
                f"write {_EXAMPLE}"
            )
        columns[role] = column
    return Path(match["file"]), columns


def recognizes(lines: Lines) -> bool:
    """A header whose names tell a time or an image, and a place, a depth or an attitude."""
    columns = guessed(lines)
    of_navigation = (
        columns.keys() - _FIXES or {"lat", "lon", "north", "east", "valid"} & columns.keys()
    )
    return bool({"time", "name"} & columns.keys() and of_navigation)


def read_by_names(lines: Lines, mount: MountConfig) -> Trajectory:
    """Read a table as ``read`` does, by the usual names of columns."""
    columns = guessed(lines)
    if _missing(columns):
        raise InputError(f"{lines.path}: {_what_it_lacks(lines, columns)}")
    return read(lines, columns, mount, by_names=True)


def _what_it_lacks(lines: Lines, columns: Mapping[str, str]) -> str:
    return (
        f"is a table without {', '.join(_missing(columns))} (it has "
        f"{', '.join(_header(lines)[1]):.150}): name its columns as in "
        f"{_EXAMPLE}{_height(lines, columns)}{_other_table(lines, columns)}"
        f"{_positions_alone(lines, columns)}"
    )


def _height(lines: Lines, columns: Mapping[str, str]) -> str:
    """What to do with a height that may be above the bottom; "" without one, or with a depth."""
    names = split_fields(lines.header, separator_of(lines.header))
    height = next((name for name in names if not _HEIGHTS.isdisjoint(words(name))), "")
    if not height or {"depth", "up"} & columns.keys():
        return ""
    return f" (up={height} only if that is a height above the water's surface, not the bottom)"


def _other_table(lines: Lines, columns: Mapping[str, str]) -> str:
    """Another table of the same times as another thing to do; "" for a table without times."""
    return f", or give the table with them, too: {lines.path.name},other.csv" * ("time" in columns)


def _positions_alone(lines: Lines, columns: Mapping[str, str]) -> str:
    """The column map of a table's positions, as another thing to do; "" where it has none."""
    fixes = {role: column for role, column in columns.items() if role in _FIXES}
    spec = ",".join(f"{role}={column}" for role, column in fixes.items())
    return "" if _missing(fixes) else f", or use its positions alone: {lines.path.name}:{spec}"


def describe_table(lines: Lines) -> str:
    """Name the columns of a table of no known format, with what to do; "" for other files."""
    separator = separator_of(lines.header)
    try:
        header = split_fields(lines.header, separator)
        rows = [split_fields(line, separator) for _, line in lines.content[:3]]
    except csv.Error:  # a cell of more than 131,072 characters
        return ""
    numbers = [sum(map(is_number, row)) for row in rows if row != header]
    if sum(map(is_number, header)) >= 2 and {len(row) for row in rows} == {len(header)}:
        return (
            f"is rows of {len(header)} columns without names ({lines.header:.60}): write their "
            "names in a line above (name, time, lat, lon, depth, heading, ...); docs/mapping.md "
            "lists the roles"
        )
    if numbers and _PLACE not in _missing(columns := guessed(lines)):
        return _what_it_lacks(lines, columns)
    if len(header) < LEAST_COLUMNS or any(map(is_number, header)) or not numbers:
        return ""
    if any(len(row) != len(header) for row in rows) or 2 * min(numbers) < len(header):
        return ""
    return (
        f"is a table whose columns are not known by their names ({', '.join(header):.150}): name "
        f"those of time, position, depth and heading as in {_EXAMPLE}; docs/mapping.md lists the "
        "roles"
    )


def guessed(lines: Lines) -> dict[str, str]:
    """Role -> the column of a usual name for it, without a date beside a time that holds one."""
    found = roles_of(split_fields(lines.header, separator_of(lines.header)))
    if "date" in found and len(found) > 1 and len(lines.content) > 1:
        table = _table(lines, {})
        if "time" not in found:
            if any(map(_WITH_CLOCK.search, table.text(found["date"].lower()))):
                found["time"] = found.pop("date")
        elif any(map(_is_dated, table.text(found["time"].lower()))):
            del found["date"]
    if "depth" in found:
        found.pop("up", None)
    return found


def _is_dated(time: str) -> bool:
    """Tell whether a time has its date: no h:m:s, and no number of a day's seconds."""
    if is_number(time):
        return abs(float(time)) >= SINCE_EPOCH
    return not (is_unknown(time) or _CLOCK.match(time))


def read(
    lines: Lines, columns: Mapping[str, str], mount: MountConfig, by_names: bool = False
) -> Trajectory:
    """The camera's poses from the vehicle's; places alone are ``fixes``. columns: role (see ROLES)
    -> column.
    by_names: nobody says that ``date`` has the day first.

    Raises InputError for what is missing.
    """
    if missing := _missing(columns):
        raise InputError(
            f"{lines.path}: the column map lacks {', '.join(missing)}: write {_EXAMPLE}"
            f"{_positions_alone(lines, columns)}"
        )
    table = _table(lines, columns)
    names = tuple(
        table.text(columns["name"].lower()) if "name" in columns else [""] * len(table.rows)
    )
    times_s = _times(table, columns, by_names)
    values, held = _between_fixes(times_s, _values(table, columns))
    track = _camera(names, times_s, values, columns.keys(), mount, _step_m(table, columns))
    return replace(track, fixes_s=held.fixes_s, notes=held.notes)


def read_together(
    tables: Sequence[tuple[Lines, Mapping[str, str]]], mount: MountConfig
) -> Trajectory:
    """Join several tables of one dive by their times: positions, attitudes, depths.

    Each is interpolated to the times of the one with the most rows; NaN in gaps of over MAX_GAP_S.

    Args:
        tables: The lines of each, and role -> column.
        mount: How the camera sits on the vehicle.

    Returns:
        The camera's poses.

    Raises:
        InputError: For what is missing, and for tables without a time in common.
    """
    together = ",".join(str(lines.path) for lines, _ in tables)
    roles = {role for _, columns in tables for role in columns} - {"name"}
    if missing := _missing(dict.fromkeys(roles, "")):
        raise InputError(f"{together}: lack {', '.join(missing)}")
    read_tables = [(_table(lines, columns), columns) for lines, columns in tables]
    times = []
    for table, columns in read_tables:
        if "time" not in columns:
            raise InputError(f"{table.lines.path}: has no times, which are needed to join tables")
        times.append(_times(table, columns, by_names=True))
    base = max(times, key=len)
    values: dict[str, Column] = {}
    fixes_s: Column | None = None
    notes: tuple[str, ...] = ()
    for (table, columns), own in zip(read_tables, times, strict=True):
        of_table, held = _between_fixes(own, _values(table, columns))
        if held.fixes_s is not None:
            fixes_s, notes = held.fixes_s, held.notes
        for role, column in of_table.items():
            joined = _at_times(base, own, column, role in _ANGLES)
            if np.isfinite(column).any() and not np.isfinite(joined).any():
                raise InputError(f"{together}: have no time in common")
            values.setdefault(role, joined)
    step_m = max(_step_m(table, columns) for table, columns in read_tables)
    track = _camera(("",) * len(base), base, values, roles, mount, step_m)
    return replace(track, fixes_s=fixes_s, notes=notes)


def _step_m(table: Table, columns: Mapping[str, str]) -> float:
    if "lat" in columns and _is_of_mavlink(table, columns):
        return METERS_PER_DEGREE / OF_MAVLINK
    if "lat" in columns:
        return step_of(table.text(columns["lat"].lower()))
    if "north" in columns:
        return step_of(table.text(columns["north"].lower()), unit(columns["north"]))
    return 0.0


def _at_times(times_s: Column, own_s: Column, values: Column, is_angle: bool) -> Column:
    """A column (N,) at other times (M,), linear in between."""
    known = np.isfinite(own_s) & np.isfinite(values)
    own, first = np.unique(own_s[known], return_index=True)
    if len(own) < 2:
        return np.full(len(times_s), np.nan)
    given = values[known][first]
    found = np.interp(
        times_s, own, np.unwrap(given, period=360.0) if is_angle else given, np.nan, np.nan
    )
    after = np.clip(np.searchsorted(own, times_s), 1, len(own) - 1)
    found[own[after] - own[after - 1] > MAX_GAP_S] = np.nan
    return np.asarray(found)


def _values(table: Table, columns: Mapping[str, str]) -> dict[str, Column]:
    """The numbers of a table by role: valid positions, degrees, depths that count down."""
    values = {
        role: _numbers(table, columns, role)
        for role in ("north", "east", "heading", "pitch", "roll", "lat", "lon")
        if role in columns
    }
    for role in ("north", "east", "lat", "lon"):
        if role in values:
            values[role][_not_valid(table, columns)] = np.nan
    if "lat" in values:
        _check_degrees(table, values)
    if len(table.rows) and _not_valid(table, columns).all():
        raise InputError(
            f"{table.lines.path}: its column {_valid_column(table, columns)!r} says of all rows "
            "that their position is not valid: leave the column out if it says something else"
        )
    if "depth" in columns:
        depth_m = _numbers(table, columns, "depth")
        values["depth"] = -depth_m if np.nansum(depth_m) < 0 else depth_m
    elif "up" in columns:
        values["depth"] = -_numbers(table, columns, "up")
    return _in_units_of_mavlink(table, columns, values)


def _between_fixes(
    times_s: Column, values: dict[str, Column]
) -> tuple[dict[str, Column], HeldFixes]:
    """The numbers with positions between the fixes that a receiver repeats."""
    roles = ("lat", "lon") if "lat" in values else ("north", "east")
    zeros = np.zeros(len(times_s))
    held = between_fixes(times_s, np.column_stack([values.get(role, zeros) for role in roles]))
    given = {role: held.positions[:, axis] for axis, role in enumerate(roles) if role in values}
    return values | given, held


def _in_units_of_mavlink(
    table: Table, columns: Mapping[str, str], values: dict[str, Column]
) -> dict[str, Column]:
    """Angles of the message ATTITUDE, which come with speeds (``yawspeed``), are in radians. Beside
    places in 1e-7 of a degree, as the message GLOBAL_POSITION_INT holds them, whole numbers are its
    millimeters and hundredths of a degree.
    """
    of_mavlink = _is_of_mavlink(table, columns)
    for role in {"heading", "pitch", "roll"} & values.keys():
        column = columns[role].lower()
        if f"{column}speed" in table.rows[0][1] or (of_mavlink and column.startswith(_ATTITUDE)):
            values[role] = np.degrees(values[role])
    if not of_mavlink:
        return values
    height = columns.get("depth") or columns.get("up") or ""
    for role, column, many, most in (
        ("depth", height, 1000.0, 1000.0),
        ("heading", columns.get("heading", ""), 100.0, 360.0),
    ):
        known = values[role][np.isfinite(values[role])] if role in values else np.zeros(0)
        is_its_own = _MESSAGE in column.lower() or (np.abs(known) > most).any()
        if is_its_own and (known == np.round(known)).all():
            unknown = values[role] == (UNKNOWN_HEADING if role == "heading" else np.inf)
            values[role] = np.where(unknown, np.nan, values[role] / many)
    return values


def _is_of_mavlink(table: Table, columns: Mapping[str, str]) -> bool:
    raw = _raw(table, columns["lat"]) if "lat" in columns else np.zeros(0)
    raw = raw[np.isfinite(raw)]
    return bool((np.abs(raw) > 1000).any() and (raw == np.round(raw)).all())


def _raw(table: Table, column: str) -> Column:
    cells = table.text(column.lower())
    return np.array([float(cell) if is_number(cell) else np.nan for cell in cells])


def _camera(
    names: tuple[str, ...],
    times_s: Column,
    values: Mapping[str, Column],
    roles: Set[str],
    mount: MountConfig,
    position_step_m: float,
) -> Trajectory:
    """The camera's poses by the vehicle's numbers; what is absent is zero."""
    zeros = np.zeros(len(times_s))
    north_east_m, origin = (
        from_degrees(values["lat"], values["lon"])
        if "lat" in values
        else (np.column_stack([values.get("north", zeros), values.get("east", zeros)]), None)
    )
    fixes = roles <= _FIXES
    attitude_deg = np.column_stack(
        [values.get(role, zeros) for role in ("roll", "pitch", "heading")]
    )
    track = VehicleTrack(
        names,
        times_s,
        north_east_m,
        values.get("depth", zeros),
        attitude_deg,
        origin,
        position_step_m,
    ).camera(MountConfig() if fixes else mount)
    return replace(track, fixes=fixes)


def _missing(columns: Mapping[str, str]) -> list[str]:
    """What the roles lack, in words; nothing where they are those of fixes."""
    missing = [
        what
        for what, choices in _NEEDED.items()
        if not any(choice <= columns.keys() for choice in choices)
    ]
    return (
        [] if columns.keys() <= _FIXES and "time" in columns and _PLACE not in missing else missing
    )


def _check_degrees(table: Table, values: Mapping[str, Column]) -> None:
    """Take out the place 0, 0. Raises InputError for degrees that cannot be."""
    latitude_deg, longitude_deg = values["lat"], values["lon"]
    for what, degrees, limit in (
        ("latitudes", latitude_deg, 90),
        ("longitudes", longitude_deg, 360),
    ):
        if (np.abs(degrees) > limit).any():
            raise InputError(
                f"{table.lines.path}: {what} reach {np.nanmax(np.abs(degrees)):.6g} degrees: are "
                "latitude and longitude exchanged, or meters or minutes in that column?"
            )
    latitude_deg[(latitude_deg == 0) & (longitude_deg == 0)] = np.nan


def _not_valid(table: Table, columns: Mapping[str, str]) -> Mask:
    """Rows that say that their position is unknown, also in an unmapped column."""
    column = _valid_column(table, columns)
    return np.array([text.lower() in _NOT_VALID for text in table.text(column.lower())], dtype=bool)


def _valid_column(table: Table, columns: Mapping[str, str]) -> str:
    return columns.get("valid") or guessed(table.lines).get("valid", "")


def _table(lines: Lines, columns: Mapping[str, str]) -> Table:
    """The header is the first line, also where it begins with ``#`` or ``%``."""
    separator, header = _header(lines)
    for role, column in columns.items():
        if not _is_of(header, column):
            near = difflib.get_close_matches(column.lower(), header, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(header)[:200]}"
            raise InputError(f"{lines.path}: has no column {column!r} for {role}; {hint}")
    rows = tuple(row for row in lines.content if row[1].lstrip("#% ") != lines.header)
    return Table.read(lines, separator, header, rows, is_whole=True)


def has_columns(lines: Lines, columns: Mapping[str, str]) -> bool:
    """Tell whether the first line names all columns of a map."""
    return all(_is_of(_header(lines)[1], column) for column in columns.values())


def _is_of(header: Sequence[str], column: str) -> bool:
    """Tell whether a header has a column, or all of several with spaces between their names."""
    return column.lower() in header or {*column.lower().split()} <= {*header}


def _header(lines: Lines) -> tuple[str, list[str]]:
    """What separates columns, and their names in lower case."""
    separator = separator_of(lines.header)
    return separator, [name.lower() for name in split_fields(lines.header, separator)]


def _numbers(table: Table, columns: Mapping[str, str], role: str) -> Column:
    """A role's column in meters or degrees."""
    column = columns[role].lower()
    if role in ("lat", "lon"):
        values = read_degrees(table, column, role)
    else:
        values = np.array(table.column(column))
    values[np.isin(values, _NO_VALUE)] = np.nan
    return values * unit(columns[role])


def _times(table: Table, columns: Mapping[str, str], by_names: bool) -> Column:
    if "time" not in columns:
        return np.full(len(table.rows), np.nan)
    day = next((columns[role] for role in ("date", "us_date") if role in columns), "")
    times = table.text(columns["time"].lower())
    named = unit(columns["time"])
    if named < 1 and all(is_number(time) for time in times):  # ms, also since a start
        return named * np.array(list(map(float, times)))
    if day and day != columns["time"]:
        times = [
            f"{date} {time}" for date, time in zip(table.text(day.lower()), times, strict=True)
        ]
    day_first = None if by_names or not day else "date" in columns
    try:
        return np.array(column_seconds(times, day_first))
    except AmbiguousDateError as error:
        raise InputError(
            f"{table.lines.path}: {error}: name the columns with date= (d/m/Y) or us_date= "
            f"(m/d/Y), as in {_EXAMPLE}"
        ) from error
    except TimeError as error:
        raise table.lines.error(
            table.rows[error.row][0], f"no time in {str(error)!r}: {ROLES['time']}"
        ) from error
