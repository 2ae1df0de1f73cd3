"""What the columns of a table of navigation are, by words in several languages, with units."""

import math
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass

from calibration.formats.reading.aliases import METERS

_WORDS = {
    "time": "time timestamp stamp utc epoch datetime zeit zeitstempel uhrzeit heure horodatage "
            "hora fechahora ora tijd tid t",
    "date": "date datum fecha dato",
    "lat": "lat latitude breite breitengrad latitud latitudine breedtegraad breddegrad",
    "lon": "lon long lng longitude lange langengrad laenge laengengrad longitud longitudine "
           "lengtegraad lengdegrad",
    "north": "north northing nord norte",
    "east": "east easting ost este",
    "depth": "depth down tiefe tauchtiefe profondeur immersion profundidad profundidade profondita "
             "diepte dybde",
    "up": "up",
    "heading": "heading hdg yaw psi kurs steuerkurs cap rumbo rumo rotta koers",
    "pitch": "pitch theta nick nicken neigung tangage cabeceo beccheggio arfagem",
    "roll": "roll phi rollen rollwinkel roulis alabeo balanceo rollio balanco",
    "valid": "valid quality",
    "name": "name file filename image imagename photo picture bild imagen",
}  # fmt: skip
"""Role -> words that name it, without accents. Altitude is none of them: vehicles measure it above
the bottom.
"""
_PHRASES = {
    "up": ({"altitude", "relative"}, {"alt", "relative"}, {"relative", "altitude"}),
    "time": (
        {"gps", "time"}, {"date", "time"}, {"time", "stamp"}, {"date", "time", "original"},
        {"create", "date"},
    ),
    "valid": ({"fix"},),
}  # fmt: skip
"""Words that name a role together."""
_BESIDE = {
    "time": "utc gps unix epoch date datum fecha iso year zulu header boot",
    "date": "utc gps",
    "name": "left file id path image photo source camera",
    "valid": "position pos fix",
    "depth": "vehicle below surface sensor ctd dfs",
    "heading": "true compass angle gyro c",
    "pitch": "angle",
    "roll": "angle",
    "lat": "decimal dd geogr geo",
    "lon": "decimal dd geogr geo",
}
"""Words that may stand beside those of a role. A depth of the water is not that of a vehicle."""
_OWNERS = (
    ("vehicle", "rov", "auv"),
    (),
    ("nav", "ekf", "filtered", "attitude", "camera"),
    ("usbl", "beacon", "ugps", "transponder", "global", "position", "int"),
    ("gps", "vfr", "hud", "raw"),
)
"""Whose a number is, the one to be taken first. What lies on a ship (``ship_lat``) is not taken."""
_OWNER_WORDS = {word for own in _OWNERS for word in own}
_NO_OWNERS = 1
_NOT_OWNERS = {"name": _OWNER_WORDS - {"camera"}, "heading": {"gps"}}
"""Role -> whose it is not: a vehicle's name is none of an image, and a receiver's heading is the
course over ground.
"""
_LAST = {"t", "tid"}
"""Words of a time that also are temperature and the number of a tag: taken without another time."""
_ON_EARTH = {"utc", "zulu", "epoch", "unix", "date", "datetime", "timestamp"}
"""Words of a time that is none since a start: taken before ``time``, which may be."""
_UNITS = {
    **METERS,
    "deg": 1.0, "degree": 1.0, "degrees": 1.0, "cdeg": 0.01, "wgs": 1.0,
    "rad": math.degrees(1), "radians": math.degrees(1),
    "s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "usec": 1e-6, "ns": 1e-9, "nsec": 1e-9,
}  # fmt: skip
"""In meters, degrees and seconds."""
_ROLE_OF = {word: role for role, words in _WORDS.items() for word in words.split()}
_TILTS = ("pitch", "roll")
TIME_PARTS = ("year", "month", "day", "hour", "minute", "second")
DAY_PARTS = TIME_PARTS[:3]
CLOCK_PARTS = (("secs", "nsecs"), ("sec", "nanosec"), ("secs", "nanosecs"), ("sec", "nsec"))


@dataclass(frozen=True)
class ColumnRole:
    """A column's role, and the rank of its owner."""

    role: str
    rank: int


def words(name: str) -> list[str]:
    """``gpsLatitude [deg]`` as gps, latitude, deg; without accents."""
    plain = unicodedata.normalize("NFKD", re.sub(r"[°º]", " deg ", name).replace("ß", "ss"))
    plain = plain.encode("ascii", "ignore").decode()
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", plain)]


def unit(name: str) -> float:
    """How many meters or degrees a column's numbers are, by its name."""
    said = words(name)
    return next((_UNITS[word] for word in reversed(said[1:]) if word in _UNITS), 1.0)


def named(name: str) -> ColumnRole | None:
    """What a column is; None where its words are not all known."""
    said = words(name)
    bare = [word for word in said if word not in _UNITS or said == [word]]
    owners = [rank for rank, own in enumerate(_OWNERS) for word in bare if word in own]
    rank = max(owners, default=_NO_OWNERS) + len(_OWNERS) * (not _LAST.isdisjoint(bare))
    rank = 2 * rank + _ON_EARTH.isdisjoint(bare)
    for phrase_role, phrases in _PHRASES.items():
        if any(set(bare) - _OWNER_WORDS == phrase - _OWNER_WORDS for phrase in phrases):
            return ColumnRole(phrase_role, rank)
    roles = [_ROLE_OF[word] for word in bare if word in _ROLE_OF and word not in ("utc", "epoch")]
    roles = roles or [_ROLE_OF[word] for word in bare if word in _ROLE_OF]
    for role in dict.fromkeys(roles):
        beside = {*_BESIDE.get(role, "").split(), *_OWNER_WORDS, *_WORDS[role].split()}
        if all(word in beside - _NOT_OWNERS.get(role, set()) for word in bare):
            return ColumnRole(role, rank)
    return None


def roles_of(names: Iterable[str]) -> dict[str, str]:
    """Role -> the column that fits best, of two alike the first.

    Columns of year, month, day, hour, minute and second, and of seconds and nanoseconds, are the
    time together, those of year, month and day beside a time the date, with spaces between their
    names.
    """
    found: dict[str, tuple[int, str]] = {}
    names = list(names)
    for name in names:
        own = named(name)
        if own and (own.role not in found or own.rank < found[own.role][0]):
            found[own.role] = (own.rank, name)
    last = {said[-1]: name for name in names if (said := words(name))}
    last |= {word.removesuffix("s"): last[word] for word in last if word[:-1] in TIME_PARTS}
    for parts in (TIME_PARTS, *CLOCK_PARTS):
        if last.keys() >= set(parts):
            found["time"] = (0, " ".join(last[part] for part in parts))
    if last.keys() >= set(DAY_PARTS) and "time" in found:
        found.setdefault("date", (0, " ".join(last[part] for part in DAY_PARTS)))
    if "kappa" in last:  # omega, phi, kappa of photogrammetry
        found = {role: own for role, own in found.items() if role not in ("heading", *_TILTS)}
    return {role: name for role, (_, name) in found.items()}
