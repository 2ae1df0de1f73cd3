"""Telemetry of small vehicles: position reports of Water Linked DVLs (A50, A125: JSON, a report a
line), and subtitles beside a video (SRT of drones and BlueOS, ASS of Cockpit).

Sources: Water Linked, *DVL protocol*; Blue Robotics, *Cockpit*; DJI's subtitles in published logs.
"""

import re

from calibration.bounded_text import load_json
from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories import column_map
from stereo_seecolor.inputs.trajectories.table import Lines
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.records import Trajectory

BEGIN = 50
"""Lines by which a file is recognized."""
_LOG = re.compile(r'"format"\s*:\s*"json_v\d')
_REPORT = re.compile(r'"type"\s*:\s*"position_local"')
_REPORTED = {
    "time": "ts",
    "north": "x",
    "east": "y",
    "depth": "z",
    "roll": "roll",
    "pitch": "pitch",
    "heading": "yaw",
}
"""Role -> key. The axes are those of the vehicle where dead reckoning was reset: x forward, y to
starboard, z down; angles in degrees.
"""
_CUE = re.compile(r"\d:\d\d:\d\d[,.]\d{1,3} --> \d")
_DIALOGUE = re.compile(r"Dialogue:(?:[^,]*,){9}")
_MOMENT = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d{1,9})?")
_SHOWN = {
    "lat": re.compile(r"\blat(?:itude)?[^\w-]{1,4}(-?\d{1,3}\.\d{1,12})", re.IGNORECASE),
    "lon": re.compile(r"\blon(?:g|gitude)?[^\w-]{1,4}(-?\d{1,3}\.\d{1,12})", re.IGNORECASE),
    "depth": re.compile(r"\bdepth[^\w-]{1,4}(-?\d{1,5}(?:\.\d{1,6})?)", re.IGNORECASE),
    "up": re.compile(
        r"\b(?:rel_?)?alt(?:itude)?[^\w-]{1,4}(-?\d{1,5}(?:\.\d{1,6})?)", re.IGNORECASE
    ),
    "heading": re.compile(
        r"\b(?:heading|hdg|yaw)[^\w-]{1,4}(-?\d{1,3}(?:\.\d{1,6})?)", re.IGNORECASE
    ),
    "roll": re.compile(r"\broll[^\w-]{1,4}(-?\d{1,3}(?:\.\d{1,6})?)", re.IGNORECASE),
    "pitch": re.compile(r"\bpitch[^\w-]{1,4}(-?\d{1,3}(?:\.\d{1,6})?)", re.IGNORECASE),
}
"""Role -> its number in the text of a subtitle: ``[latitude: 63.4]``, ``Heading: 90 deg``."""


def is_report(lines: Lines) -> bool:
    """True for reports of a DVL by Water Linked, of position or velocity."""
    return any(_REPORT.search(line) or _LOG.search(line) for line in lines.all[:BEGIN])


def read_reports(lines: Lines, mount: MountConfig) -> Trajectory:
    """The vehicle's poses from where dead reckoning was reset; reports of velocity are passed over.

    Raises InputError for a line that is no JSON, and for a log of velocities alone.
    """
    rows = [",".join(_REPORTED)]
    for number, line in lines.content:
        if not _REPORT.search(line):
            continue
        try:
            report = load_json(line)
        except ValueError as error:
            raise lines.error(number, "is not a report of a DVL (JSON, one a line)") from error
        rows.append(",".join(str(report.get(key, "")) for key in _REPORTED.values()))
    if len(rows) == 1:
        raise InputError(
            f"{lines.path}: is a log of a Water Linked DVL with velocities only: log its "
            "position reports (position_local), too"
        )
    return _read(lines, rows, mount)


def is_srt(lines: Lines) -> bool:
    """True for subtitles in SRT."""
    return any(_CUE.search(line) for line in lines.all[:BEGIN])


def is_ass(lines: Lines) -> bool:
    """True for subtitles in ASS (Advanced SubStation)."""
    return lines.first.strip() == "[Script Info]"


def read_subtitles(lines: Lines, mount: MountConfig) -> Trajectory:
    """Places and attitudes that subtitles show, at the times that they show.

    Raises InputError where they show no date and time, or no position.
    """
    cues = _cues(lines)
    found = [
        {"time": moment[0].replace(",", "."), **_values(text)}
        for text in cues
        if (moment := _MOMENT.search(text))
    ]
    if not found:
        raise InputError(
            f"{lines.path}: is subtitles whose {len(cues)} lines of text show no date and time: "
            "their times count from the start of a video; give a table with time, lat, lon, depth"
        )
    if not any({"lat", "lon"} <= row.keys() for row in found):
        shown = ", ".join(sorted({role for row in found for role in row}))
        raise InputError(
            f"{lines.path}: is subtitles that show {shown}, and no position: join them with one as "
            "tables, position.csv,telemetry.csv, or leave the track to the images"
        )
    roles = [role for role in ("time", *_SHOWN) if any(role in row for row in found)]
    if "heading" not in roles:  # places alone, as a buoy's
        roles = ["time", "lat", "lon"]
    elif "depth" in roles and "up" in roles:
        roles.remove("up")
    rows = [",".join(roles), *(",".join(row.get(role, "") for role in roles) for row in found)]
    return _read(lines, rows, mount)


def _cues(lines: Lines) -> list[str]:
    """The text of each subtitle."""
    spoken = [line for _, line in lines.content if _DIALOGUE.match(line)]
    if spoken:
        return [_DIALOGUE.sub("", line, count=1).replace(r"\N", " ") for line in spoken]
    return re.split(r"^.*-->.*$", "\n".join(lines.all), flags=re.MULTILINE)[1:]


def _values(text: str) -> dict[str, str]:
    return {role: shown[1] for role, known in _SHOWN.items() if (shown := known.search(text))}


def _read(lines: Lines, rows: list[str], mount: MountConfig) -> Trajectory:
    """Read rows of comma-separated text whose header names roles."""
    table = Lines(lines.path, tuple(rows), tuple(enumerate(rows, start=1)))
    return column_map.read(table, {role: role for role in rows[0].split(",")}, mount)


WATER_LINKED = TextFormat("position reports of Water Linked", is_report, read_reports, is_json=True)
SRT = TextFormat("telemetry in subtitles (SRT)", is_srt, read_subtitles)
ASS = TextFormat("telemetry in subtitles (ASS)", is_ass, read_subtitles, is_json=True)
"""``is_json``: its first line begins with a bracket, as JSON does."""
