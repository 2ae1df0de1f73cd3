"""Latitudes and longitudes in a column of a table, in any notation of degrees."""

import re

import numpy as np

from stereo_seecolor.inputs.trajectories.columns import words
from stereo_seecolor.inputs.trajectories.table import Table, is_number
from stereo_seecolor.inputs.trajectories.times import is_unknown
from stereo_seecolor.inputs.trajectories.vehicle_track import Column

DEGREES = re.compile(
    r"([NSEWO])?\s*([+-]?\d++(?:\.\d++)?)(?:(?:\s*(?:[°º\ufffd:]|deg)\s*+|\s++)"
    r"(?:(\d++(?:\.\d++)?)['’′:\s]*+(?:(\d++(?:\.\d++)?)\s*+(?:[\"”″]|'')?)?)?)?\s*([NSEWO])?",
    re.IGNORECASE,
)
"""Degrees, minutes and seconds, as far as there are, and the hemisphere before or after:
``14°41'6.0"S``, ``14 deg 41' 6.00" S``, ``14.685 S``.
"""
MINUTES = re.compile(r"(\d{2,3})(\d{2}\.\d+)( [NSEW])", re.IGNORECASE)
"""Degrees and minutes as receivers write them, ddmm.mmmm, with the hemisphere."""
HEMISPHERES = {"lat": {"N", "S", "NORTH", "SOUTH"}, "lon": {"E", "W", "EAST", "WEST"}}
_OF_HEMISPHERE = {"n", "s", "ns", "e", "w", "ew", "ref", "dir", "direction", "hemi", "hemisphere"}
"""Words in the names of their columns."""
OF_MAVLINK = 1e7
"""Whole numbers a degree."""


def read_degrees(table: Table, column: str, role: str) -> Column:
    """Read latitudes or longitudes, whose hemisphere may stand in the next column or in one named
    for it; whole numbers beyond all degrees are MAVLink's 1e-7 of one.
    """
    names = list(table.rows[0][1])
    after = names[names.index(column) + 1 :][:1]
    named = [name for name in names if not _OF_HEMISPHERE.isdisjoint(words(name))]
    of_side = next((name for name in (*after, *named) if _says_hemisphere(table, name, role)), "")
    cells = [f"{row[column]} {row.get(of_side, '')[:1]}".strip() for _, row in table.rows]
    if of_side and all(is_unknown(cell) or MINUTES.fullmatch(cell) for cell in cells):
        cells = [MINUTES.sub(r"\1 \2\3", cell) for cell in cells]
    values = np.array(
        [_degrees(table, number, cell) for (number, _), cell in zip(table.rows, cells, strict=True)]
    )
    known = values[np.isfinite(values) & (values != 0)]
    of_mavlink = known.size and (np.abs(known) > 1000).all() and (known == np.round(known)).all()
    return values / OF_MAVLINK if of_mavlink else values


def _says_hemisphere(table: Table, column: str, role: str) -> bool:
    """Tell whether cells are N and S, or E and W, or these words."""
    said = {row[column].upper() for _, row in table.rows} - {""}
    return bool(said) and said <= HEMISPHERES[role]


def _degrees(table: Table, number: int, text: str) -> float:
    """Of ``14.685``, ``14.685 S`` or ``14°41'6"S``."""
    text = text.strip()
    match = None if is_number(text) or is_unknown(text) else DEGREES.fullmatch(text)
    if match is None:
        return float("nan") if is_unknown(text) else table.lines.numbers(number, [text])[0]
    degrees, minutes, rest = (float(match[i] or 0) for i in (2, 3, 4))
    negative = (match[1] or match[5] or "N").upper() in "SW" or match[2].startswith("-")
    return (-1 if negative else 1) * (abs(degrees) + minutes / 60 + rest / 3600)
