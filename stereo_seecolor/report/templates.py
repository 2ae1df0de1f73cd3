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
    environment.filters["address"] = lambda path: "/".join(map(_path, path.split("/")))
    return environment.from_string((STATIC / name).read_text(encoding="utf-8"))


def _path(name: str) -> str:
    """A file's name as part of an address."""
    return quote(name, safe="", errors="surrogateescape")


HOLE = re.compile(r'\{"":(\d+)\}')
"""Where bytes belong in a script; no text has it, since its quotes would be escaped."""
FIRST = 0x100
"""Of the 2^15 characters for 15 bits: none of them needs escaping, and none is half a pair."""


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
    """15 bits a character, which takes a sixth less than base85; before them a digit, the number of
    bytes that only fill the last one.
    """
    spare = -len(content) % 15
    filled = np.frombuffer(content + bytes(spare), np.uint8).reshape(-1, 15).astype(np.uint32)
    units = np.empty((len(filled), 8), np.uint16)
    for place in range(8):
        byte, bit = divmod(15 * place, 8)
        three = [filled[:, byte + i] if byte + i < 15 else np.uint32(0) for i in range(3)]
        bits = three[0] << np.uint32(16) | three[1] << np.uint32(8) | three[2]
        units[:, place] = (bits >> np.uint32(9 - bit)) & np.uint32(0x7FFF)
    few = -(-8 * len(content) // 15)
    characters = (units.ravel()[:few] + np.uint16(FIRST)).astype("<u2").tobytes()
    return f"{15 * few // 8 - len(content)}{characters.decode('utf-16-le')}"
