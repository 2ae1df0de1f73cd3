"""Reads what the page's scripts hold, as web/src/codes.ts does."""

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.report.templates import ESCAPE, MOVED


def script_values(path: Path) -> list[Any]:
    """The values that a script hands over; bytes as text (``bytes_of``)."""
    content = path.read_bytes()
    text = content.decode("utf-16" if content[:1] == b"\xff" else "ascii")
    return list(json.loads(f"[{text[text.index('(') + 1 : text.rindex(')')]}]"))


def dive_of(out: Path) -> dict[str, Any]:
    """The data of a dive that the page of OUT begins with; ``shown`` by the frames' names."""
    (dive,) = script_values(out / "page/dive.js")
    dive |= json.loads(zlib.decompress(bytes_of(dive.pop("frames"))))
    pairs = zip(dive["names"], dive["shown"], strict=True)
    return dive | {"shown": {name: dive["products"][kind] for name, kind in pairs if kind >= 0}}


def bytes_of(text: str) -> bytes:
    """Bytes from characters of two, of which some are escaped."""
    units = np.frombuffer(text[1:].encode("utf-16-le"), "<u2")
    escapes = np.flatnonzero(units == ESCAPE)
    turned = units.copy()
    turned[escapes + 1] ^= np.uint16(MOVED)
    return np.delete(turned, escapes).tobytes()[: -int(text[0]) or None]


def numbers_of(content: bytes) -> NDArray[np.int64]:
    """Whole numbers, from their differences."""
    low, middle, high = np.frombuffer(zlib.decompress(content), np.uint8).reshape(3, -1).astype(int)
    folded = low | middle << 8 | high << 16
    return np.cumsum((folded >> 1) ^ -(folded & 1))


def colors_of(content: bytes) -> NDArray[np.uint8]:
    """(N, 3) colors of the vertices of a mesh."""
    red, green, blue = numbers_of(content).reshape(3, -1)
    return (4 * np.stack([red + green, green, blue + green], axis=1) + 2).astype(np.uint8)
