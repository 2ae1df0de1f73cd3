"""Fills templates of pages, with values escaped, and writes their data as scripts."""

import json
import re
from functools import cache
from typing import Any
from urllib.parse import quote

import jinja2
import numpy as np

from stereo_seecolor.report.texts import STATIC


def render_template(name: str, **values: Any) -> bytes:
    """A template of static/, filled in. Raises jinja2's UndefinedError."""
    return _template(name).render(**values).encode("utf-8", errors="replace")


@cache
def _template(name: str) -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["path"] = _path
    environment.filters["address"] = lambda path: "/".join(map(_path, path.split("/")))
    return environment.from_string((STATIC / name).read_text(encoding="utf-8"))


def _path(name: str) -> str:
    """A file's name as part of an address."""
    return quote(name, safe="", errors="surrogateescape")


HOLE = re.compile(r'\{"":(\d+)\}')
"""Where bytes belong in a script; no text has it, since its quotes would be escaped."""
ESCAPE, MOVED = 0x100, 0x4000
"""Two bytes are a character; one that a text may not hold as it is stands behind the first of
these, with a bit of the second turned.
"""


def script(receiver: str, *values: Any) -> bytes:
    """Data as a script, ``seecolor.RECEIVER(VALUE, ...)``: a page opened from a file may load
    scripts and images, and nothing else.

    ASCII, or UTF-16 if values hold bytes (web/src/codes.ts reads them); its byte order mark makes
    any server's encoding right. NaN and infinity must be None.
    """
    held: list[bytes] = []

    def hold(content: bytes) -> dict[str, int]:
        held.append(content)
        return {"": len(held) - 1}

    parts = ",".join(
        json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"), default=hold)
        for value in values
    )
    text = f"seecolor.{receiver}({parts});\n"
    if not held:
        return text.encode("ascii")
    return HOLE.sub(lambda hole: f'"{_characters(held[int(hole[1])])}"', text).encode("utf-16")


def _characters(content: bytes) -> str:
    """Two bytes a character, of which 4 % take two; before them a digit, the number of bytes that
    only fill the last one.
    """
    units = np.frombuffer(content + bytes(len(content) % 2), "<u2")
    escaped = (units <= ESCAPE) | (units & 0xF800 == 0xD800)  # signs of the language; half pairs
    escaped |= np.isin(units, (0x2028, 0x2029, 0xFEFF, 0xFFFE, 0xFFFF))  # ends of lines; no letters
    place = np.arange(len(units)) + escaped.cumsum()
    characters = np.full(len(units) + int(escaped.sum()), ESCAPE, "<u2")
    characters[place] = np.where(escaped, units ^ MOVED, units)
    return f"{len(content) % 2}{characters.tobytes().decode('utf-16-le')}"
