"""Reads what the page's scripts hold, as web/src/codes.ts does."""

import json
import zlib
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.report.plane_code import CLIP, MOST_AROUND, SHIFT, UNARY
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


def decoded(content: bytes, shape: tuple[int, int]) -> NDArray[np.int64]:
    """The whole numbers of a grid."""
    bits, (height, width) = _Bits(content), shape
    values = np.zeros(shape, np.int64)
    for row in range(height):
        for column in range(width):
            up = int(values[row - 1, column]) if row else None
            left = int(values[row, column - 1]) if column else up or 0
            up = left if up is None else up
            above = int(values[row - 1, column - 1]) if row and column else (left if column else up)
            right = int(values[row - 1, column + 1]) if row and column + 1 < width else up
            value = sorted((left, up, left + up - above))[1]
            values[row, column] = value + _error(bits, (right - up, up - above, above - left))
    return values


def _error(bits: "_Bits", near: tuple[int, int, int]) -> int:
    context = tuple(max(-CLIP, min(each, CLIP)) for each in near)
    if not bits.next("begun", context):
        return 0
    negative = bits.next("sign", context)
    around = min(sum(map(abs, near)), MOST_AROUND)
    rest = 0
    while rest < UNARY and bits.next("further", around, rest):
        rest += 1
    if rest == UNARY:
        size = 0
        while bits.next("count", size):
            size += 1
        number = 1
        for place in reversed(range(size)):
            number = 2 * number + bits.next("place", place)
        rest += number - 1
    return -1 - rest if negative else 1 + rest


class _Bits:
    """A binary arithmetic decoder; its chances go by what is asked for."""

    def __init__(self, content: bytes) -> None:
        self.rest, self.low, self.high, self.code = iter(content), 0, 0xFFFFFFFF, 0
        self.chances: dict[Any, int] = defaultdict(lambda: 1 << 15)
        for _ in range(4):
            self._read()

    def _read(self) -> None:
        self.code = (self.code << 8 | next(self.rest, 0)) & 0xFFFFFFFF

    def next(self, *of: Any) -> int:
        chance = self.chances[of]
        middle = self.low + ((self.high - self.low) * chance >> 16)
        bit = self.code <= middle
        self.low, self.high = (self.low, middle) if bit else (middle + 1, self.high)
        self.chances[of] = chance + (65536 - chance >> SHIFT) if bit else chance - (chance >> SHIFT)
        while self.low >> 24 == self.high >> 24:
            self.low, self.high = self.low << 8 & 0xFFFFFFFF, self.high << 8 & 0xFFFFFFFF | 255
            self._read()
        return int(bit)
