"""What the camera recorded in EXIF: exposure, time, position; and the EXIF block that a corrected
image keeps.
"""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np
from PIL import ExifTags, Image

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.text_documents import dict_reader, read_text
from stereo_seecolor.inputs.headers import EXIF_PREFIX, exif_block
from stereo_seecolor.records import Capture

KEPT_TAGS = (
    ExifTags.Base.ImageDescription,
    ExifTags.Base.Make,
    ExifTags.Base.Model,
    ExifTags.Base.DateTime,
    ExifTags.Base.Artist,
    ExifTags.Base.Copyright,
)
DROPPED_DETAILS = (
    ExifTags.Base.MakerNote,
    ExifTags.Base.ExifImageWidth,
    ExifTags.Base.ExifImageHeight,
    ExifTags.Base.ExifInteroperabilityOffset,
)

PLAUSIBLE = (1e-9, 1e9)
"""Exposures in seconds, ISO numbers and f-numbers beyond these are damage."""

_UPRIGHT = 1
_DATE = "%Y:%m:%d %H:%M:%S"
_DATE_WITH_ZONE = f"{_DATE}%z"
_Tags = dict[int, Any]
_Found = TypeVar("_Found")


def read_capture(content: bytes) -> Capture:
    """The EXIF of a JPEG, PNG or TIFF. What is missing or damaged is None: metadata never fail a
    frame.
    """
    return _from_exif(content, _capture, Capture())


def _from_exif(content: bytes, read: Callable[[Image.Exif], _Found], otherwise: _Found) -> _Found:
    """What ``read`` finds in a file's EXIF; ``otherwise`` without EXIF, or where it is damaged:
    Pillow raises errors of many kinds then, and the pixels are judged elsewhere.
    """
    if not (block := exif_block(content)):
        return otherwise
    with suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of damaged tags
        exif = Image.Exif()
        exif.load(EXIF_PREFIX + block)
        return read(exif)
    return otherwise


def orientation(content: bytes) -> int:
    """How EXIF says that an image is to be turned for display, 1 to 8; 1, upright, without a tag.
    ``content``: the beginning of a file is enough.
    """
    tag = _from_exif(content, lambda exif: exif.get(ExifTags.Base.Orientation), None)
    return tag if isinstance(tag, int) and 1 <= tag <= 8 else _UPRIGHT


MOST_ZOOM = 100.0
"""Digital zooms beyond this are damage."""
_CROPPED = re.compile(rb"crs:HasCrop\s*(=\s*[\"']|>)\s*True", re.IGNORECASE)
"""What Adobe's converters write into XMP of a picture that was cut out."""
ASPECT = 0.02
"""Least change of the ratio of width to height that is not rounding."""


def framing(content: bytes, size: tuple[int, int]) -> str:
    """Tell how a picture was cut out of the sensor's, as far as its metadata say.

    Args:
        content: Of the file.
        size: Width and height of its image, pixels.

    Returns:
        Words such as "has a digital zoom of 1.5"; "" where nothing is said.
    """
    nothing: _Tags = {}
    tags = _from_exif(content, lambda exif: exif.get_ifd(ExifTags.IFD.Exif), nothing)
    zoom = _positive_capture(tags.get(ExifTags.Base.DigitalZoomRatio)) or 1.0
    if 1.0 < zoom < MOST_ZOOM:
        return f"has a digital zoom of {zoom:g}"
    if _CROPPED.search(content):
        return "was cut out by a converter (XMP: HasCrop)"
    width, height = (
        _positive_capture(tags.get(key))
        for key in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
    )
    if not width or not height:
        return ""
    was, now = (max(pair) / min(pair) for pair in ((width, height), size))
    return f"was {width:g}x{height:g} px in the camera" if abs(was / now - 1) > ASPECT else ""


def _capture(exif: Image.Exif) -> Capture:
    details: _Tags = exif.get_ifd(ExifTags.IFD.Exif)
    gps: _Tags = exif.get_ifd(ExifTags.IFD.GPSInfo)
    iso = _positive_capture(details.get(ExifTags.Base.ISOSpeedRatings))
    return Capture(
        exposure_s=_positive_capture(details.get(ExifTags.Base.ExposureTime)),
        gain=None if iso is None else iso / 100,
        aperture=_positive_capture(details.get(ExifTags.Base.FNumber)),
        captured_s=_time(details),
        latitude_deg=_degrees(
            gps.get(ExifTags.GPS.GPSLatitude), gps.get(ExifTags.GPS.GPSLatitudeRef), "S"
        ),
        longitude_deg=_degrees(
            gps.get(ExifTags.GPS.GPSLongitude), gps.get(ExifTags.GPS.GPSLongitudeRef), "W"
        ),
        exif=_kept(exif, details, gps),
    )


def _kept(exif: Image.Exif, details: _Tags, gps: _Tags) -> bytes:
    """The block for the corrected image: upright, without thumbnail, image layout, and the maker's
    notes, whose offsets break.
    """
    kept = Image.Exif()
    kept.update({tag: exif[tag] for tag in KEPT_TAGS if tag in exif})
    kept.get_ifd(ExifTags.IFD.Exif).update(
        {tag: value for tag, value in details.items() if tag not in DROPPED_DETAILS}
    )
    kept.get_ifd(ExifTags.IFD.GPSInfo).update(gps)
    if not (len(kept) or details or gps):
        return b""
    kept[ExifTags.Base.Orientation] = _UPRIGHT
    return kept.tobytes().removeprefix(EXIF_PREFIX)


def _time(tags: _Tags) -> float | None:
    """Seconds since 1970; a camera that does not state its zone is taken to be at UTC."""
    date = _text(tags.get(ExifTags.Base.DateTimeOriginal))
    fraction = _text(tags.get(ExifTags.Base.SubsecTimeOriginal))
    zone = _text(tags.get(ExifTags.Base.OffsetTimeOriginal))
    try:
        whole = (
            datetime.strptime(date + zone, _DATE_WITH_ZONE)
            if zone
            else datetime.strptime(date, _DATE).replace(tzinfo=UTC)
        )
        return whole.timestamp() + (
            float(f"0.{fraction}") if fraction.isascii() and fraction.isdigit() else 0.0
        )
    except (ValueError, OverflowError):
        return None


def _degrees(parts: Any, reference: Any, negative: str) -> float | None:
    try:
        degrees = float(np.dot([float(part) for part in parts], [1, 1 / 60, 1 / 3600]))
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    if not 0 <= degrees <= 180:
        return None
    return -degrees if _text(reference).upper() == negative else degrees


def _positive_capture(value: Any) -> float | None:
    first = value[0] if isinstance(value, tuple) and value else value
    try:
        number = float(first)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if PLAUSIBLE[0] <= number <= PLAUSIBLE[1] else None


def _text(value: Any) -> str:
    return value.strip("\x00 ") if isinstance(value, str) else ""


# Exposure and gain of each frame from a table: for cameras that write them to a log and not into
# their images.

NAMES = (
    "name", "file", "filename", "file_name", "image", "image_name", "path", "relative_path",
    "source_file",
)  # fmt: skip
EXPOSURES = ("exposure_s", "exposure_ms", "exposure_us", "exposure_time", "shutter_speed")
"""Usual names; without a unit seconds, as in EXIF."""
_SECONDS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "milliseconds": 1e-3, "us": 1e-6,
    "µs": 1e-6, "microseconds": 1e-6,
}  # fmt: skip
_FRACTION = re.compile(r"\s*(\d+(?:\.\d+)?)\s*/\s*(\d+(?:\.\d+)?)\s*")
"""``1/400``, as exiftool writes a time."""

MOST_CHARACTERS = 10_000
"""Of a line; more is another file."""

GAINS = ("gain", "gain_db", "iso")


@dataclass(frozen=True)
class ExposureTable:
    """Exposure and gain by file: its name, its stem, or either after the name of its folder."""

    rows: Mapping[str, Capture]

    @classmethod
    def read(cls, path: Path) -> "ExposureTable":
        """Read a CSV with a header: a column of file names; exposure_s (or _ms, _us); gain (a
        factor), gain_db or iso.

        A file's name may lack its suffix, and needs its folder (``left/0001.png``) only where both
        sides use the same names.
        Raises InputError for a file that cannot be read or has no such columns, and for a bad
        value, naming the line.
        """
        text = read_text(path)
        if max(map(len, text.splitlines()), default=0) > MOST_CHARACTERS:
            raise InputError(
                f"{path}: has a line of more than {MOST_CHARACTERS} characters: is it a table of "
                "exposures?"
            )
        reader = dict_reader(text)
        reader.fieldnames = [_plain(name) for name in reader.fieldnames or ()]
        units_s = {name: unit for name in reader.fieldnames if (unit := _unit_s(name))}
        name, exposure, gain = (
            _column(path, reader.fieldnames, known) for known in (NAMES, tuple(units_s), GAINS)
        )
        if not name or not (exposure or gain):
            raise InputError(
                f"{path}: needs a header with a column of file names ({', '.join(NAMES)}) and "
                f"exposure or gain ({', '.join((*EXPOSURES, *GAINS))})"
            )
        rows = {}
        for row in reader:
            where = f"{path}: line {reader.line_num}"
            exposure_s = (
                _positive_exposure(where, row, exposure) * units_s[exposure] if exposure else None
            )
            rows[_key(row[name] or "")] = Capture(
                exposure_s, _gain(where, row, gain) if gain else None
            )
        return cls(rows)

    def applied(self, capture: Capture, image: Path) -> Capture:
        """``capture`` with what the table says of ``image`` in place of what the camera wrote."""
        folder = image.parent.name
        keys = (f"{folder}/{image.name}", f"{folder}/{image.stem}", image.name, image.stem)
        row = next((self.rows[key] for key in keys if key in self.rows), Capture())
        exposure_s = capture.exposure_s if row.exposure_s is None else row.exposure_s
        return replace(
            capture, exposure_s=exposure_s, gain=capture.gain if row.gain is None else row.gain
        )


def _plain(name: str) -> str:
    """``Exposure Time [ms]`` as exposure_time_ms, ``SourceFile`` as source_file."""
    found = re.findall(r"dB|[µμ]s|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    return "_".join(word.lower().replace("μ", "µ") for word in found)


def _unit_s(name: str) -> float | None:
    """Seconds of the unit of a column of exposure times; None for another column, and for
    ``exposure`` alone, whose unit is open.
    """
    words = set(name.split("_"))
    what = words & {"exposure", "shutter", "integration", "exposuretime"}
    rest = words - what - {"time", "speed"}
    if not what or len(rest) > 1 or words == {"exposure"}:
        return None
    return _SECONDS.get(rest.pop()) if rest else 1.0


def _column(path: Path, header: Sequence[str], known: Sequence[str]) -> str:
    """The one column of the header that is known, "" where there is none."""
    found = [name for name in header if name in known]
    if len(found) > 1:
        raise InputError(f"{path}: has the columns {' and '.join(found)}: leave one")
    return found[0] if found else ""


def _key(name: str) -> str:
    """The file with its folder, if that is given."""
    return "/".join(PurePosixPath(name.strip().replace("\\", "/")).parts[-2:])


def _gain(where: str, row: Mapping[str, str], column: str) -> float:
    """As a factor: 1 is 0 dB or ISO 100."""
    if column == "gain_db":
        return float(10 ** (_number(where, row, column) / 20))
    return _positive_exposure(where, row, column) / (100 if column == "iso" else 1)


def _positive_exposure(where: str, row: Mapping[str, str], column: str) -> float:
    number = _number(where, row, column)
    if number <= 0:
        raise InputError(f"{where}: {column} must be more than 0, got {number:g}")
    return number


def _number(where: str, row: Mapping[str, str], column: str) -> float:
    text = row[column] or ""
    if (fraction := _FRACTION.fullmatch(text)) and float(fraction[2]):
        text = str(float(fraction[1]) / float(fraction[2]))
    try:
        number = float(text)
    except ValueError as error:
        raise InputError(
            f"{where}: {column} must be a number, got {row[column] or ''!r}"
        ) from error
    if not np.isfinite(number) or abs(number) > 1e9:
        raise InputError(f"{where}: {column} is {number:g}: no camera has that")
    return number
