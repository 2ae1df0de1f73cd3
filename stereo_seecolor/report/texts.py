"""The texts of the page, from one file, so that it can be translated; and numbers as text."""

from functools import cache
from importlib.resources import files
from typing import Any

from calibration.bounded_text import load_json

STATIC = files("stereo_seecolor.report") / "static"


@cache
def texts() -> dict[str, str]:
    """The page's texts by key; a text may hold {names} of values."""
    content: dict[str, str] = load_json((STATIC / "texts.json").read_bytes())
    return content


def phrase(key: str, **values: Any) -> str:
    """The text of a key, filled in. Raises KeyError for an unknown key."""
    return texts()[key].format(**values)


def digits(value: float, count: int = 3) -> str:
    """A number with ``count`` digits, never in powers of ten; below a millionth 0."""
    if abs(value) < 1e-6:
        return "0"
    text = f"{value:.{count}g}"
    if "e" not in text:
        return text
    return f"{value:.0f}" if abs(value) >= 1 else f"{value:.6f}".rstrip("0")


def duration(seconds: float) -> str:
    """A duration in seconds, minutes or hours."""
    if seconds < 120:
        return phrase("unit.s", value=digits(seconds))
    if seconds < 7200:
        return phrase("unit.min", value=digits(seconds / 60))
    return phrase("unit.h", value=digits(seconds / 3600))


def length(meters: float) -> str:
    """A length in millimeters, centimeters or meters."""
    if meters < 0.02:
        return phrase("unit.mm", value=digits(1000 * meters))
    if meters < 1:
        return phrase("unit.cm", value=digits(100 * meters))
    return phrase("unit.m", value=digits(meters))
