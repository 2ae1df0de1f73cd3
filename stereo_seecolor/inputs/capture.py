"""What the camera recorded in EXIF: exposure, time, position; and the block to keep."""

import re
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any, TypeVar

import numpy as np
from PIL import ExifTags, Image

from calibration.quiet import ignored_warnings
from stereo_seecolor.files.image_headers import EXIF_PREFIX, exif_block
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
    """The EXIF of a JPEG, PNG or TIFF; what is missing or damaged is None."""
    return _from_exif(content, _capture, Capture())


def _from_exif(content: bytes, read: Callable[[Image.Exif], _Found], otherwise: _Found) -> _Found:
    """What ``read`` finds in a file's EXIF; ``otherwise`` without EXIF, or where it is damaged:
    Pillow raises errors of many kinds then, and the pixels are judged elsewhere.
    """
    if not (block := exif_block(content)):
        return otherwise
    with suppress(Exception), ignored_warnings():  # of damaged tags
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


def focal_mm(content: bytes) -> float | None:
    """The focal length that EXIF states. ``content``: the beginning of a file is enough."""
    return _positive_capture(_details(content).get(ExifTags.Base.FocalLength))


def _details(content: bytes) -> _Tags:
    nothing: _Tags = {}
    return _from_exif(content, lambda exif: exif.get_ifd(ExifTags.IFD.Exif), nothing)


MOST_ZOOM = 100.0
"""Digital zooms beyond this are damage."""
_EDITED = re.compile(
    rb"crs:(?:(hascrop)\s*(?:=\s*[\"']|>)\s*true|(lensprofileenable)\s*(?:=\s*[\"']|>)\s*1"
    rb"|(perspectiveupright)\s*(?:=\s*[\"']|>)\s*[1-9])"
)
"""What Adobe's converters write into XMP of an image whose shape they changed, in small letters: a
search for both kinds takes ten times as long.
"""
_EDITS = (
    "was cut out by a converter (XMP: HasCrop)",
    "had its lens distortion removed by a converter (XMP: LensProfileEnable)",
    "was turned or stretched by a converter (XMP: PerspectiveUpright)",
)
ASPECT = 0.02
"""Least change of the ratio of width to height that is not rounding."""


def framing(content: bytes, size: tuple[int, int]) -> str:
    """How an image of ``size`` was made from the sensor's, as far as the file's metadata say, such
    as "has a digital zoom of 1.5"; "" if they say nothing.
    """
    tags = _details(content)
    zoom = _positive_capture(tags.get(ExifTags.Base.DigitalZoomRatio)) or 1.0
    if 1.0 < zoom < MOST_ZOOM:
        return f"has a digital zoom of {zoom:g}"
    if edited := _EDITED.search(content.lower()):
        return next(what for what, found in zip(_EDITS, edited.groups(), strict=True) if found)
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
