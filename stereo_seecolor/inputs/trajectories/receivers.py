"""Positions that satellite and acoustic receivers log, as tables of fixes: NMEA 0183 (RMC, or GGA
with ZDA), GPX, KML tracks.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stereo_seecolor.config import MountConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.column_map import read as read_columns
from stereo_seecolor.inputs.trajectories.table import Lines
from stereo_seecolor.records import Trajectory

SENTENCES = {
    "HDT": ("heading", 1),
    "THS": ("heading", 1),
    "HDG": ("heading", 1),
    "HDM": ("heading", 1),
    "DPT": ("depth", 1),
    "DBS": ("depth", 3),
}
"""Sentence beside positions -> what it tells, and in which of its fields: degrees or meters."""
_SENTENCE = re.compile(
    r"\$(\w{2}(RMC|GGA|GLL|ZDA|HDT|THS|HDG|HDM|DPT|DBS),[^*$]*)(?:\*([0-9A-Fa-f]{2}))?"
)
_BEACON = re.compile(r"\$(PSONLLD|PSIMSSB|PSIMLBP),")
"""Sentences of USBL and LBL systems (Sonardyne, Kongsberg)."""
_POINT = r"(?:\w+:)?(?:trkpt|wpt|rtept)\b"
_GPX = re.compile(
    rf"<(?:\w+:)?(trkpt|wpt|rtept)\b([^<>]*)>([^<]*(?:<(?!/?{_POINT})[^<]*)*)</(?:\w+:)?\1>"
)
"""A point, which holds no other."""
PLACE = r"\b{}\s*=\s*[\"']([^\"']+)[\"']"
_TIME = re.compile(r"<(?:\w+:)?time>([^<]+)</")
_KML = re.compile(r"<when>([^<]+)</when>|<gx:coord>\s*([^\s<]+)\s+([^\s<]+)[^<]*</gx:coord>")


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
    fixes = read_columns(*table(lines, {}), mount)
    others = {SENTENCES[match[2]][0]: match[2] for _, match in _sentences(lines, *SENTENCES)}
    if not others:
        return fixes
    spec = ",".join(f"{role}={name}" for role, name in others.items())
    note = (
        f"{lines.path.name}: {' and '.join(others)} ({', '.join(others.values())}) are not used, "
        "because they may come from the compass or echo sounder of a ship: if they come from "
        f"the vehicle of the camera, give --poses {lines.path.name}:{spec}"
    )
    return replace(fixes, notes=(note,))


def table(lines: Lines, columns: Mapping[str, str]) -> tuple[Lines, dict[str, str]]:
    """Positions with their times as a table of navigation.

    Args:
        lines: Of the log.
        columns: Role -> sentence of NMEA whose value stands beside each position:
            ``heading=HDT,depth=DPT``.

    Returns:
        The table, and the map of its columns.

    Raises:
        InputError: Where no position has a time, and for sentences that are not read.
    """
    text = "\n".join(lines.all)
    names = list(columns.values())
    if "<gpx" in text[:4000]:
        rows = [_gpx_row(point[2], point[3]) for point in _GPX.finditer(text)]
    elif "<kml" in text[:4000]:
        rows = _kml_rows(text)
    elif beacon := _BEACON.search(text):
        raise InputError(
            f"{lines.path}: holds positions of an acoustic beacon ({beacon[1]}) and of the ship, "
            "which are not those of the camera: save the positions of the beacon as CSV with "
            "time, lat, lon, depth"
        )
    else:
        rows = _nmea_rows(lines, names)
    known = [row for row in rows if row]
    if not known:
        raise InputError(
            f"{lines.path}: holds no position with a date and time (NMEA: RMC, or GGA or GLL "
            "with ZDA)"
        )
    header = ",".join(["time", "lat", "lon", *names])
    made = replace(lines, all=(header,), content=((1, header), *enumerate(known, start=2)))
    return made, {"time": "time", "lat": "lat", "lon": "lon", **columns}


def _gpx_row(attributes: str, inner: str) -> str:
    place = [re.search(PLACE.format(name), attributes) for name in ("lat", "lon")]
    time = _TIME.search(inner)
    return (
        f"{time[1].strip()},{place[0][1]},{place[1][1]}" if time and place[0] and place[1] else ""
    )


def _kml_rows(text: str) -> list[str]:
    found = list(_KML.finditer(text))
    times, places = (
        [match[1].strip() for match in found if match[1]],
        [match for match in found if match[2]],
    )
    return [f"{time},{place[3]},{place[2]}" for time, place in zip(times, places, strict=False)]


def _nmea_rows(lines: Lines, names: Sequence[str]) -> list[str]:
    """Those of RMC, which has the date; of GGA where there is no RMC, with the date of the last
    ZDA. Each with the value of the sentence of each of the names that belongs to it.
    """
    if unknown := [name for name in names if name not in SENTENCES]:
        raise InputError(
            f"{lines.path}: {unknown[0]} is not one of the supported sentences: "
            f"{', '.join(SENTENCES)}"
        )
    found = _sentences(lines, "RMC", "GGA", "GLL", "ZDA")
    names_found = {match[2] for _, match in found}
    has_rmc, has_gga = "RMC" in names_found, "GGA" in names_found
    rows: list[tuple[int, str]] = []
    day = ""
    for number, match in found:
        fields = match[1].split(",")
        if match[2] == "ZDA" and len(fields) > 4:
            day = f"{fields[4]}-{fields[3]}-{fields[2]}"
        elif match[2] == "RMC" and len(fields) > 9 and fields[2] == "A" and len(fields[9]) == 6:
            date = f"20{fields[9][4:]}-{fields[9][2:4]}-{fields[9][:2]}"
            rows.append((number, _row(date, fields[1], fields[3:7])))
        elif (
            match[2] == "GGA"
            and not has_rmc
            and day
            and len(fields) > 6
            and fields[6] not in ("", "0")
        ):
            rows.append((number, _row(day, fields[1], fields[2:6])))
        elif match[2] == "GLL" and not (has_rmc or has_gga) and day and fields[6:7] == ["A"]:
            rows.append((number, _row(day, fields[5], fields[1:5])))
    rows = [(number, row) for number, row in rows if row]
    beside = [_beside(lines, name, [number for number, _ in rows]) for name in names]
    return [",".join((row, *others)) for (_, row), *others in zip(rows, *beside, strict=True)]


def _sentences(lines: Lines, *names: str) -> list[tuple[int, re.Match[str]]]:
    """The whole sentences of some names, each with the number of its line."""
    return [
        (number, match)
        for number, line in enumerate(lines.all)
        for match in _SENTENCE.finditer(line)
        if match[2] in names and _is_whole(match[1], match[3])
    ]


def _beside(lines: Lines, name: str, places: Sequence[int]) -> list[str]:
    """The value of the sentence of a name that belongs to each line: the next one where they begin
    after the first of the lines, else the last one; "" without one.
    """
    found = _sentences(lines, name)
    if not found or not places:
        return [""] * len(places)
    numbers = [number for number, _ in found]
    nearest = np.searchsorted(numbers, places) - (numbers[0] < places[0])
    fields = [match[1].split(",") for _, match in found]
    _, field = SENTENCES[name]
    return [
        fields[i][field] if i < len(fields) and len(fields[i]) > field else ""
        for i in nearest.tolist()
    ]


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
