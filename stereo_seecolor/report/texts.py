"""The texts of the page, from one file, so that it can be translated; and numbers as text."""

import json
from functools import cache
from importlib.resources import files
from typing import Any
from urllib.parse import quote

import jinja2

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
    """A number with ``count`` significant digits, never in powers of ten; what is below a millionth
    is 0.
    """
    if abs(value) < 1e-6:
        return "0"
    text = f"{value:.{count}g}"
    return (
        f"{value:.0f}"
        if "e" in text and abs(value) >= 1
        else f"{value:.6f}".rstrip("0")
        if "e" in text
        else text
    )


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


# Fills templates of pages, with values escaped, and writes their data as scripts.


def filled_in(name: str, **values: Any) -> bytes:
    """A template of static/, filled in with values. Raises jinja2's UndefinedError for a missing
    value.
    """
    return _template(name).render(**values).encode("utf-8", errors="replace")


@cache
def _template(name: str) -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["path"] = _path
    return environment.from_string((STATIC / name).read_text(encoding="utf-8"))


def _path(name: str) -> str:
    """A file's name as part of an address."""
    return quote(name, safe="", errors="surrogateescape")


def script(receiver: str, *values: Any) -> bytes:
    """Data as a script, ``seecolor.RECEIVER(VALUE, ...)``: a page opened from a file may load
    scripts and images, and nothing else.

    ASCII; NaN and infinity must be None.
    """
    parts = (
        json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
        for value in values
    )
    return f"seecolor.{receiver}({','.join(parts)});\n".encode("ascii")
