"""Fills templates of pages, with values escaped, and writes their data as scripts."""

import json
from functools import cache
from typing import Any
from urllib.parse import quote

import jinja2

from stereo_seecolor.report.texts import STATIC


def render_template(name: str, **values: Any) -> bytes:
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
