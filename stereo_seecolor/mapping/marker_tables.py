"""Tables of measured markers: scale bars and surveyed places, in this program's columns,
ReefShape's or Metashape's.

Columns are found by words. Without a header, bars are first, second, length in meters, and places
are marker, x, y, z in meters.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.formats.reading.aliases import METERS
from stereo_seecolor.earth import north_east_from_degrees
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.csv_tables import is_unit, separator_of, split_fields
from stereo_seecolor.files.text_documents import read_text
from stereo_seecolor.records import Array, GeoOrigin

USUAL_STD_M = 0.01
"""Standard error of a surveyed place where the table has none, meters: divers' tape, level."""
LONGEST_BAR_M = 20.0
"""Lengths without a unit that are longer are in centimeters or millimeters."""
LEAST_APART_M = 0.05
"""All markers of a table within so much in x and y are degrees, not meters."""
_UNITS = "|".join(sorted(METERS, key=len, reverse=True))
LINES_ABOVE = 10
"""Most lines of titles and remarks above a header."""
BAR = {
    "first": r"first( point)?|from|von|de|start|a|(marker|point|target|tag|id|p) ?(1|a)|label",
    "second": r"second( point)?|to|bis|end|b|(marker|point|target|tag|id|p) ?(2|b)",
    "length": r"(measured )?(length|distance|dist|l|länge|laenge|abstand|longueur|longitud)( in)?",
}
PLACE = {
    "marker": r"(gis )?(marker|label|target|tag|name|id|point|punkt|gcp|nr|no)( (id|name|nr|no))?",
    "x": r"(utm )?(x|x/easting|easting|east|e)|rechtswert|ost",
    "y": r"(utm )?(y|y/northing|northing|north|n)|hochwert|nord",
    "z": r"z|z/altitude|altitude|height|elevation|elev|rl|up|h|höhe|hoehe",
    "depth": r"(marker )?(depth|tiefe|profondeur|profundidad)",
    "lat": r"(gis |y/)?lat(itude)?", "lon": r"(gis |x/)?lo?ng?(itude)?",
    "std": r"std|acc(uracy)?( x/y/z)?", "xy_std": r"xy ?acc(uracy)?|xy std|acc(uracy)? x(/?y)?",
    "z_std": r"z ?acc(uracy)?|z std|acc(uracy)? z",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Places:
    """Surveyed places of markers by number: (3,) meters, z up, and standard errors.

    origin: where (0, 0) lies, of places in latitude and longitude; x is east and y north of it.
    """

    points: dict[int, Array]
    stds_m: dict[int, float]
    origin: GeoOrigin | None = None


def read_bars(path: Path) -> dict[tuple[int, int], float]:
    """Scale bars: both markers' numbers -> length, meters. Raises InputError, with the line."""
    rows, columns, units = _table(path, BAR, ("first", "second", "length"))
    bars: dict[tuple[int, int], float] = {}
    for where, cells in rows:
        ends = (
            [cells[columns["first"]], cells[columns["second"]]]
            if "second" in columns
            else cells[columns["first"]].split("_")
        )
        if len(ends) != 2:
            raise InputError(
                f"{where}: {cells[columns['first']]!r} does not name two markers: write first, "
                "second, length_m"
            )
        length_m = _number(where, cells[columns["length"]]) * units.get("length", 1.0)
        if not 0 < length_m <= LONGEST_BAR_M:
            raise InputError(
                f"{where}: a scale bar of {length_m:g} m: name its unit in the header, as "
                "length_m, length_cm or length_mm"
            )
        first, second = (_marker(where, end) for end in ends)
        if first == second:
            raise InputError(f"{where}: a bar from marker {first} to itself: name two markers")
        known_m = bars.get((first, second), bars.get((second, first), length_m))
        if known_m != length_m:
            raise InputError(
                f"{where}: bar {first}-{second} has two lengths, {known_m:g} and {length_m:g} m: "
                "leave one"
            )
        if (second, first) not in bars:
            bars[first, second] = length_m
    return bars


def read_places(path: Path, origin: GeoOrigin | None = None) -> Places:
    """Surveyed places. origin: for latitudes and longitudes; None: the first marker.

    Raises InputError, naming the line, also for degrees in the columns of meters.
    """
    rows, columns, units = _table(path, PLACE, ("marker", "x", "y", "z"))
    numbers = [_marker(where, cells[columns["marker"]]) for where, cells in rows]
    for number, (where, _) in zip(numbers, rows, strict=True):
        if numbers.count(number) > 1:
            raise InputError(f"{where}: marker {number} has two positions: leave one")
    values = {
        role: np.array(
            [_number(where, cells[column]) * units.get(role, 1.0) for where, cells in rows]
        )
        for role, column in columns.items()
        if role != "marker"
    }
    z = values["z"] if "z" in values else -np.abs(values["depth"])
    if "lat" in values:
        if (np.abs(values["lat"]) > 90).any():
            raise InputError(
                f"{path}: a latitude of {values['lat'][np.abs(values['lat']).argmax()]:g} degrees: "
                "are lat and lon exchanged?"
            )
        origin = origin or GeoOrigin(float(values["lat"][0]), float(values["lon"][0]))
        north_east = north_east_from_degrees(values["lat"], values["lon"], origin)
        points = np.column_stack([north_east[:, ::-1], z])
    else:
        points, origin = np.column_stack([values["x"], values["y"], z]), None
        if (
            len(points) > 1
            and np.ptp(points[:, :2], axis=0).max() < LEAST_APART_M
            and (np.abs(points[:, :2]) <= [180, 90]).all()
        ):
            raise InputError(
                f"{path}: its markers lie within {LEAST_APART_M:g} m: if x and y are degrees, "
                "name the columns lon and lat"
            )
    stds = values.get(
        "std", np.maximum(values.get("xy_std", np.zeros(1)), values.get("z_std", np.zeros(1)))
    )
    stds = np.broadcast_to(np.where(stds > 0, stds, USUAL_STD_M), len(points))
    return Places(
        dict(zip(numbers, points, strict=True)),
        dict(zip(numbers, map(float, stds), strict=True)),
        origin,
    )


def _table(
    path: Path, names: dict[str, str], in_order: Sequence[str]
) -> tuple[list[tuple[str, list[str]]], dict[str, int], dict[str, float]]:
    """Rows with their place, role -> column, and role -> unit in meters, of a header or of the
    usual order without one.
    """
    lines = [
        (f"{path}: line {number}", re.sub(r"^#+\s*", "#", line))
        for number, line in enumerate(read_text(path).splitlines(), start=1)
        if line.strip("#;,\t ")
    ]
    heads = [line for _, line in lines[:LINES_ABOVE]]
    most = max(heads, key=lambda line: max(map(line.count, ",;\t|")), default="")
    separator = separator_of(most)
    cells = [(where, row) for where, line in lines if (row := _cells(where, line, separator))]
    if not cells:
        raise InputError(f"{path}: holds no rows")
    of_header = 2 if names is BAR else 3
    found = (len(_roles(path, row, names)[0]) for _, row in cells[:LINES_ABOVE])
    cells = cells[next((i for i, roles in enumerate(found) if roles >= of_header), 0) :]
    first, units = cells[0][1], dict[str, float]()
    if len(first) >= len(in_order) and _is_number(first[len(in_order) - 1]):
        columns, rows = {role: i for i, role in enumerate(in_order)}, cells
    else:
        columns, units = _roles(path, first, names)
        _check(path, columns, first, names)
        rows = cells[1:]
        if len(rows) > 1 and all(is_unit(cell) for cell in rows[0][1]):
            rows = rows[1:]
    # a template's own words, and remarks as Metashape's "# Total Error"
    rows = [(where, row) for where, row in rows if not re.match(r"\[|#\D*$", row[0])]
    if not rows:
        raise InputError(f"{path}: holds no rows below its header")
    if short := next((where for where, row in rows if len(row) <= max(columns.values())), None):
        raise InputError(f"{short}: has too few columns for {', '.join(first)}")
    return rows, columns, units


def _roles(
    path: Path, header: list[str], names: dict[str, str]
) -> tuple[dict[str, int], dict[str, float]]:
    columns: dict[str, int] = {}
    units: dict[str, float] = {}
    for i, cell in enumerate(header):
        said = (
            re.sub(r"[_\s]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", cell.lstrip("[#")))
            .strip()
            .lower()
        )
        unit = re.search(rf"(?<![ (\[])[ (\[]*\b({_UNITS})[)\]]*$", said)
        other = None if unit else re.search(r"[(\[](\w+)[)\]]$", said)
        bare = re.split(r"[(\[]", said[: unit.start()] if unit else said)[0].strip(" ]")
        role = next(
            (
                role
                for role, pattern in names.items()
                if role not in columns and re.fullmatch(pattern, bare)
            ),
            None,
        )
        if role and other and role in ("length", "x", "y", "z", "depth"):
            raise InputError(
                f"{path}: column {cell!r}: its unit is unknown: write {', '.join(METERS)}"
            )
        if role:
            columns[role] = i
            units[role] = METERS[unit[1]] if unit else 1.0
    return columns, units


def _check(path: Path, columns: dict[str, int], header: list[str], names: dict[str, str]) -> None:
    """Raise InputError for a header that lacks what is needed, by documented names."""
    if names is BAR:
        one_label = header[0].strip(" #").lower() == "label"  # of both ends, as Metashape writes it
        missing = [
            role
            for role in ("first", "second", "length")
            if role not in columns and not (one_label and role == "second")
        ]
        wanted = "first, second, length_m"
    else:
        plan = ("lat", "lon") if {"lat", "lon"} & columns.keys() else ("x", "y")
        missing = [role for role in ("marker", *plan) if role not in columns]
        missing += [] if {"z", "depth"} & columns.keys() else ["z"]
        wanted = "marker, x_m, y_m, z_m, or marker, lat, lon, depth_m"
    if missing:
        named = {"x": "x_m", "y": "y_m", "z": "z_m", "length": "length_m"}.get(
            missing[0], missing[0]
        )
        raise InputError(
            f"{path}: has no column {named!r} (it has {', '.join(header)[:100]}): give the "
            f"columns {wanted}"
        )


def _cells(where: str, line: str, separator: str) -> list[str]:
    try:
        cells = split_fields(line, separator)
    except csv.Error as error:  # a cell of more than 131,072 characters
        raise InputError(f"{where}: {error}: is it a table of markers?") from error
    return (
        [re.sub(r"^([+-]?\d+),(\d+)$", r"\1.\2", cell) for cell in cells]
        if separator != ","
        else cells
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(where: str, text: str) -> float:
    """A number; with a unit behind it, in meters."""
    if match := re.fullmatch(rf"([-+]?[\d.]+)\s*({_UNITS})", text.strip().lower()):
        return _number(where, match[1]) * METERS[match[2]]
    if not text.strip():
        raise InputError(f"{where}: a number is missing: fill it in, or leave the line out")
    if not _is_number(text) or not np.isfinite(float(text)):
        raise InputError(f"{where}: {text!r} is not a number")
    return float(text)


def _marker(where: str, label: str) -> int:
    """Of ``7``, ``target 7``, ``tag36h11_7`` or ``36h11:00f``, RealityCapture's, which is 15."""
    if found := re.search(r"^\W*\d\w*:([0-9a-f]{3})\W*$", label):
        return int(found[1], 16)
    found = re.search(r"(\d+)\D*$", label)
    if found is None:
        raise InputError(
            f"{where}: {label!r} is not a number of a marker, nor a label that ends in one"
        )
    return int(found[1])
