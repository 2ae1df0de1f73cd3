"""Positions that satellite and acoustic receivers log, as tables of fixes: NMEA 0183 (RMC, or GGA
with ZDA), GPX, KML tracks.
"""

import re
from dataclasses import replace

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.column_map import read as read_columns
from stereo_seecolor.inputs.trajectories.table import Lines
from stereo_seecolor.records import Trajectory

_SENTENCE = re.compile(r"\$(\w{2}(RMC|GGA|ZDA),[^*$]*)(?:\*([0-9A-Fa-f]{2}))?")
_GPX = re.compile(r"<(?:\w+:)?(?:trkpt|wpt)\b([^>]*)>(.*?)</(?:\w+:)?(?:trkpt|wpt)>", re.DOTALL)
_TIME = re.compile(r"<(?:\w+:)?time>\s*([^<]+?)\s*</")
_KML = re.compile(r"<when>\s*([^<]+?)\s*</when>|<gx:coord>\s*(\S+)\s+(\S+)[^<]*</gx:coord>")


def recognizes(lines: Lines) -> bool:
    """Sentences of NMEA among the first lines, or points of GPX or a KML track with times."""
    begin = "\n".join(lines.all[:40])
    return (
        _SENTENCE.search(begin) is not None
        or "<gpx" in begin
        or ("<kml" in begin and any("<when>" in line for line in lines.all))
    )


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Fixes of the receiver: positions without depth or attitude, with their times. Raises
    InputError where none has both.
    """
    text = "\n".join(lines.all)
    if "<gpx" in text[:4000]:
        rows = [_gpx_row(point[1], point[2]) for point in _GPX.finditer(text)]
    elif "<kml" in text[:4000]:
        rows = _kml_rows(text)
    else:
        rows = _nmea_rows(lines)
    known = [row for row in rows if row]
    if not known:
        raise InputError(
            f"{lines.path}: holds no position with a date and time (NMEA: RMC, or GGA with ZDA)"
        )
    table = replace(
        lines, all=("time,lat,lon",), content=((1, "time,lat,lon"), *enumerate(known, start=2))
    )
    return read_columns(table, {"time": "time", "lat": "lat", "lon": "lon"}, mount)


def _gpx_row(attributes: str, inner: str) -> str:
    place = [
        re.search(rf"\b{name}\s*=\s*[\"']([^\"']+)[\"']", attributes) for name in ("lat", "lon")
    ]
    time = _TIME.search(inner)
    return f"{time[1]},{place[0][1]},{place[1][1]}" if time and place[0] and place[1] else ""


def _kml_rows(text: str) -> list[str]:
    found = list(_KML.finditer(text))
    times, places = (
        [match[1] for match in found if match[1]],
        [match for match in found if match[2]],
    )
    return [f"{time},{place[3]},{place[2]}" for time, place in zip(times, places, strict=False)]


def _nmea_rows(lines: Lines) -> list[str]:
    """Those of RMC, which has the date; of GGA where there is no RMC, with the date of the last
    ZDA.
    """
    found = [
        match
        for line in lines.all
        for match in _SENTENCE.finditer(line)
        if _is_whole(match[1], match[3])
    ]
    has_rmc = any(match[2] == "RMC" for match in found)
    rows, day = [], ""
    for match in found:
        fields = match[1].split(",")
        if match[2] == "ZDA" and len(fields) > 4:
            day = f"{fields[4]}-{fields[3]}-{fields[2]}"
        elif match[2] == "RMC" and len(fields) > 9 and fields[2] == "A" and len(fields[9]) == 6:
            rows.append(
                _row(f"20{fields[9][4:]}-{fields[9][2:4]}-{fields[9][:2]}", fields[1], fields[3:7])
            )
        elif (
            match[2] == "GGA"
            and not has_rmc
            and day
            and len(fields) > 6
            and fields[6] not in ("", "0")
        ):
            rows.append(_row(day, fields[1], fields[2:6]))
    return rows


def _row(day: str, time: str, place: list[str]) -> str:
    """Of hhmmss.ss and ddmm.mmmm,S,dddmm.mmmm,E."""
    if len(time) < 6 or not all(
        re.fullmatch(r"\d{3,5}(\.\d+)?", number) for number in (place[0], place[2])
    ):
        return ""
    lat, lon = (
        f"{number.split('.')[0][:-2] or 0} {number[len(number.split('.')[0]) - 2 :]} {side}"
        for number, side in (place[:2], place[2:])
    )
    return f"{day} {time[:2]}:{time[2:4]}:{time[4:]},{lat},{lon}"


def _is_whole(sentence: str, checksum: str | None) -> bool:
    """Tell whether the sentence has its checksum, or none."""
    total = 0
    for byte in sentence.encode():
        total ^= byte
    return checksum is None or total == int(checksum, 16)
