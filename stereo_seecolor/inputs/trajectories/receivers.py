"""Positions that satellite and acoustic receivers log, as tables of fixes: NMEA 0183 (RMC, or GGA
with ZDA), Sonardyne's beacons (PSONLLD with ZDA or RMC), GPX, KML tracks.
"""

import re
from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta

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
    r"\$(\w{2}(RMC|GGA|GLL|GNS|ZDA|HDT|THS|HDG|HDM|DPT|DBS),[^*$]*)(?:\*([0-9A-Fa-f]{2}))?"
)
_BEACON = re.compile(r"\$(PSIMSSB|PSIMLBP),")
"""Sentences of USBL and LBL systems (Kongsberg) that are not read."""
_INS = re.compile(r"\$(PIXSE),")
"""Sentences of inertial navigation systems (iXblue) that are not read."""
SONARDYNE = "PSONLLD"
_SONARDYNE = re.compile(r"\$(PSONLLD,[^*$]*)(?:\*([0-9A-Fa-f]{2}))?")
_SHIP = re.compile(r"ship|vessel|crp", re.IGNORECASE)
"""Names that Sonardyne's systems give to the ship itself, which they report as they do beacons."""
_POINT = r"(?:\w+:)?(?:trkpt|wpt|rtept)\b"
_GPX = re.compile(
    rf"<(?:\w+:)?(trkpt|wpt|rtept)\b([^<>]*)>([^<]*(?:<(?!/?{_POINT})[^<]*)*)</(?:\w+:)?\1>"
)
"""A point, which holds no other."""
PLACE = r"\b{}\s*=\s*[\"']([^\"']+)[\"']"
_TIME = re.compile(r"<(?:\w+:)?time>([^<]+)</")
_KML = re.compile(r"<when>([^<]+)</when>|<gx:coord>\s*([^\s<]+)\s+([^\s<]+)[^<]*</gx:coord>")

_KML_WHEN = re.compile(r"<when>([^<]+)</when>")
_KML_PLACE = re.compile(r"<coordinates>\s*([^,<\s]+),([^,<\s]+)")


def recognizes(lines: Lines) -> bool:
    """NMEA among the first lines, beacons with a date, or points of GPX or a timed KML track."""
    begin = "\n".join(lines.all[:40])
    return (
        _SENTENCE.search(begin) is not None
        or (
            f"${SONARDYNE}," in begin
            and any("ZDA," in line or "RMC," in line for line in lines.all)
        )
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
            ``heading=HDT,depth=DPT``; ``depth=PSONLLD`` is a beacon's own.

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
    elif f"${SONARDYNE}," in text:
        rows = _beacon_rows(lines, names)
    else:
        rows = _nmea_rows(lines, names)
    known = [row for row in rows if row]
    if not known and (of_ins := _INS.search(text)):
        raise InputError(
            f"{lines.path}: holds the output of an inertial navigation system ({of_ins[1]}), whose "
            "sentences are not read: save it as CSV with time, lat, lon, depth, heading, pitch, "
            "roll"
        )
    if not known:
        raise InputError(
            f"{lines.path}: holds no position with a date and time (NMEA: RMC, or GGA, GNS or GLL "
            "with ZDA; PSONLLD with ZDA or RMC; GPX: <time> in points; KML: <when> in tracks or "
            "points)"
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
    times = [match[1].strip() for match in found if match[1]]
    places = [match for match in found if match[2]]
    if not places:
        return [_kml_point_row(placemark) for placemark in text.split("<Placemark")[1:]]
    return [f"{time},{place[3]},{place[2]}" for time, place in zip(times, places, strict=False)]


def _kml_point_row(placemark: str) -> str:
    """Of a point with its time; "" for another placemark."""
    time = _KML_WHEN.search(placemark)
    place = _KML_PLACE.search(placemark.partition("<Point")[2])
    return f"{time[1].strip()},{place[2]},{place[1]}" if time and place else ""


def _nmea_rows(lines: Lines, names: Sequence[str]) -> list[str]:
    """Those of RMC, which has the date; of GGA, GNS or GLL where there is no RMC, with the date of
    the last ZDA. Each with the value of the sentence of each of the names that belongs to it.
    """
    _refuse_unknown(lines, names, SENTENCES)
    found = _sentences(lines, "RMC", "GGA", "GNS", "GLL", "ZDA")
    names_found = {match[2] for _, match in found}
    # quality 0, and modes of N, are of no fix
    of_day = next((name for name in ("RMC", "GGA", "GNS") if name in names_found), "")
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
            match[2] == of_day and day and len(fields) > 6 and fields[6].strip("N") not in ("", "0")
        ):
            rows.append((number, _row(day, fields[1], fields[2:6])))
        elif match[2] == "GLL" and not of_day and day and fields[6:7] == ["A"]:
            rows.append((number, _row(day, fields[5], fields[1:5])))
    rows = [(number, row) for number, row in rows if row]
    beside = [_beside(lines, name, [number for number, _ in rows]) for name in names]
    return [",".join((row, *others)) for (_, row), *others in zip(rows, *beside, strict=True)]


def _refuse_unknown(lines: Lines, names: Sequence[str], known: Collection[str]) -> None:
    if unknown := [name for name in names if name not in known]:
        raise InputError(
            f"{lines.path}: {unknown[0]} is not one of the supported sentences: {', '.join(known)}"
        )


def _beacon_rows(lines: Lines, names: Sequence[str]) -> list[str]:
    """Those of the one beacon of a Sonardyne system, with the day of the last ZDA or RMC before
    each, or of the first one.

    Raises InputError for several beacons, and where no sentence has a date.
    """
    _refuse_unknown(lines, names, (*SENTENCES, SONARDYNE))
    days = [
        (number, day)
        for number, match in _sentences(lines, "ZDA", "RMC")
        if (day := _moment(match[2], match[1].split(",")))
    ]
    if not days:
        raise InputError(
            f"{lines.path}: is a log of a Sonardyne USBL (PSONLLD), whose times have no date, and "
            "no ZDA or RMC in it gives one: log one of these beside it, or save it as CSV with "
            "time, lat, lon, depth"
        )
    fixes = [
        (number, fix)
        for number, line in enumerate(lines.all)
        for match in _SONARDYNE.finditer(line)
        if _is_whole(match[1], match[2]) and (fix := _beacon_fix(match[1].split(",")))
    ]
    beacons = sorted({name for _, (name, *_) in fixes})
    if len(beacons) > 1:
        raise InputError(
            f"{lines.path}: holds the places of several beacons ({', '.join(beacons)}): keep the "
            "lines of the one on the camera's vehicle"
        )
    rows = []
    beside = {
        name: _beside(lines, name, [number for number, _ in fixes])
        for name in names
        if name != SONARDYNE
    }
    for i, (number, (_, clock, lat, lon, depth)) in enumerate(fixes):
        before = max(bisect_right(days, number, key=lambda day: day[0]) - 1, 0)
        moment = _at_clock(days[before][1], clock)
        others = [depth if name == SONARDYNE else beside[name][i] for name in names]
        rows.append(",".join((f"{moment:%Y-%m-%d %H:%M:%S.%f}", lat, lon, *others)))
    return rows


def _beacon_fix(fields: list[str]) -> tuple[str, str, str, str, str] | None:
    """Name, time of day, latitude, longitude and depth of a PSONLLD that is valid and not of the
    ship. The status stands before or after the name: it is the field that a place follows.
    """
    for at in (2, 3):
        status, place = fields[at : at + 1], fields[at + 1 : at + 4]
        if status not in (["A"], ["V"]) or len(place) < 3:
            continue
        if not all(re.fullmatch(r"[+-]?\d{1,6}(\.\d{1,12})?", number) for number in place):
            continue
        name = fields[2] if at == 3 else ""
        is_place = abs(float(place[0])) <= 90 and abs(float(place[1])) <= 180
        is_time = re.fullmatch(r"[0-2]\d[0-5]\d[0-5]\d(\.\d{1,9})?", fields[1])
        if status == ["A"] and is_place and is_time and not _SHIP.search(name):
            return name, fields[1], place[0], place[1], place[2]
    return None


def _moment(kind: str, fields: list[str]) -> datetime | None:
    """The date and time of a ZDA or RMC; None where it has none."""
    try:
        if kind == "ZDA":
            day = datetime(int(fields[4]), int(fields[3]), int(fields[2]))
        else:
            day = datetime(2000 + int(fields[9][4:6]), int(fields[9][2:4]), int(fields[9][:2]))
        return day + _since_midnight(fields[1])
    except (ValueError, IndexError):
        return None


def _at_clock(moment: datetime, clock: str) -> datetime:
    """The time of day hhmmss.ss on the day of a moment; of the day before or after where that is
    nearer to it.
    """
    midnight = moment.replace(hour=0, minute=0, second=0, microsecond=0)
    found = midnight + _since_midnight(clock)
    return found + timedelta(days=round((moment - found) / timedelta(days=1)))


def _since_midnight(clock: str) -> timedelta:
    return timedelta(hours=int(clock[:2]), minutes=int(clock[2:4]), seconds=float(clock[4:]))


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
