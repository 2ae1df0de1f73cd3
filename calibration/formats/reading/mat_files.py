"""MATLAB's Level 5 MAT-file, as ``save`` writes it (v6 and v7), objects included.

From MathWorks, *MAT-File Format*, R2019b, chapter 1; the undocumented opaque class and the
subsystem as they are found in files. Not read with SciPy: its reader does not support objects, and
allocates what a damaged file claims to hold. Here nothing is allocated beyond the bytes that are
there, no code is run, and sizes and depths are bounded.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

HEADER_BYTES = 128  # of a Level 5 file (MathWorks, MAT-File Format)
MAX_INFLATED_BYTES = 32 * 2**20  # a calibration of 300 views with all its errors is 1 MB
MAX_ELEMENTS = 50_000  # as of a text file: see document.py
MAT5_MAX_DEPTH = 20  # levels, as of a text file

STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
    16: "u1",
    17: "u2",
    18: "u4",
}
MI_MATRIX, MI_COMPRESSED = 14, 15  # data types (MAT-File Format, table 1-1)
CELL, STRUCT, OBJECT, CHAR, OPAQUE = 1, 2, 3, 4, 17  # array classes (table 1-3)
NUMERIC = range(6, 16)
CUT = "is cut off or damaged: an element reaches beyond its end"
ENCODINGS = {16: "utf-8", 17: "utf-16", 18: "utf-32"}


@dataclass(frozen=True)
class Opaque:
    """A variable of a class: its place in the subsystem."""

    reference: Any


class Mat5Reader:
    """Reads elements of a buffer. order: "<" or ">". most_bytes: of a deflated variable."""

    def __init__(self, data: bytes, order: str, most_bytes: int = MAX_INFLATED_BYTES) -> None:
        self._data, self._order, self._most_bytes = data, order, most_bytes
        self._elements = 0

    def variables(self, start: int) -> Iterator[tuple[str, Any]]:
        """Name and value of each variable from ``start`` on: an array, text, list (cell), dict
        (struct) or Opaque.
        """
        position = start
        while position + 8 <= len(self._data):
            kind, payload, position = self._element(self._data, position)
            if kind == MI_COMPRESSED:
                kind, payload, _ = self._element(_inflate(payload, self._most_bytes), 0)
            if kind == MI_MATRIX:
                yield self._matrix(payload, 0)

    def _element(self, data: bytes, position: int) -> tuple[int, bytes, int]:
        """Type, payload and the position of the next element."""
        self._elements += 1
        if self._elements > MAX_ELEMENTS:
            raise CalibrationError(
                f"holds more than {MAX_ELEMENTS} elements, which no calibration does"
            )
        kind, size = self._integers(data, position, 2)
        start = position + 8
        if kind >> 16:  # small: size and type in one word, data in the other
            kind, size, start = kind & 0xFFFF, kind >> 16, position + 4
            following = position + 8
        else:
            following = start + size + (0 if kind == MI_COMPRESSED else -size % 8)
        if start + size > len(data):
            raise CalibrationError(CUT)
        return kind, data[start : start + size], following

    def _integers(self, data: bytes, position: int, count: int) -> tuple[int, ...]:
        if position + 4 * count > len(data):
            raise CalibrationError(CUT)
        return struct.unpack_from(f"{self._order}{count}I", data, position)

    def _matrix(self, data: bytes, depth: int) -> tuple[str, Any]:
        """Name and value of the payload of an miMATRIX."""
        if depth > MAT5_MAX_DEPTH:
            raise CalibrationError(
                f"is nested deeper than {MAT5_MAX_DEPTH} levels, which no calibration is"
            )
        if not data:
            return "", np.zeros((0, 0))
        parts = _Parts(self, data)
        kind = self._integers(parts.next(), 0, 1)[0] & 0xFF
        if kind == OPAQUE:
            name, _, _ = (_text(parts.next()) for _ in range(3))  # its system and class
            return name, Opaque(self._matrix(parts.next(), depth + 1)[1])
        shape = tuple(self._array(*parts.typed()).astype(np.int64).tolist())
        name = _text(parts.next())
        if min(shape, default=0) < 0:
            raise CalibrationError("is damaged: an array with a negative size")
        if kind in NUMERIC:
            return name, _shaped(self._array(*parts.typed()), shape)
        if kind == CHAR:
            return name, _characters(*parts.typed(), self._order)
        if kind == CELL:
            return name, [
                self._matrix(parts.next(), depth + 1)[1] for _ in range(_count(shape, len(data)))
            ]
        if kind in (STRUCT, OBJECT):
            return name, self._struct(parts, kind, _count(shape, len(data)), depth)
        return name, None

    def _struct(self, parts: "_Parts", kind: int, count: int, depth: int) -> Any:
        if kind == OBJECT:
            parts.next()  # the name of the class
        width = int(self._array(*parts.typed())[0])
        names = parts.next()
        if not 1 <= width <= len(names) or len(names) > MAX_ELEMENTS:
            if names:
                raise CalibrationError("is damaged: field names of no length")
            return {}
        keys = [_text(names[i : i + width]) for i in range(0, len(names), width)]
        if count * len(keys) > MAX_ELEMENTS:
            raise CalibrationError("is damaged: a struct of more fields than the file has bytes")
        structs = [
            {key: self._matrix(parts.next(), depth + 1)[1] for key in keys} for _ in range(count)
        ]
        return structs[0] if count == 1 else structs

    def _array(self, kind: int, payload: bytes) -> NDArray[np.generic]:
        if kind not in STORED:
            raise CalibrationError(f"is damaged: numbers of unknown type {kind}")
        dtype = np.dtype(self._order + STORED[kind])
        if len(payload) % dtype.itemsize:
            raise CalibrationError("is damaged: half a number")
        return np.frombuffer(payload, dtype)


class _Parts:
    """The elements inside one payload, one after the other."""

    def __init__(self, reader: Mat5Reader, data: bytes) -> None:
        self._reader, self._data, self._position = reader, data, 0

    def typed(self) -> tuple[int, bytes]:
        kind, payload, self._position = self._reader._element(self._data, self._position)
        return kind, payload

    def next(self) -> bytes:
        return self.typed()[1]


def byte_order(mark: bytes) -> str:
    """ "<" or ">" of the two bytes that end a header. Raises CalibrationError for anything else."""
    if mark not in (b"IM", b"MI"):
        raise CalibrationError("is damaged: its header names no byte order")
    return "<" if mark == b"IM" else ">"


def _inflate(payload: bytes, most_bytes: int) -> bytes:
    inflater = zlib.decompressobj()
    try:
        data = inflater.decompress(payload, most_bytes)
    except zlib.error as error:
        raise CalibrationError(f"is damaged: {error}") from error
    if inflater.unconsumed_tail:
        raise CalibrationError(
            f"holds a variable of more than {most_bytes >> 20} MB, which no calibration does"
        )
    return data


def _shaped(values: NDArray[np.generic], shape: tuple[int, ...]) -> NDArray[np.generic]:
    if values.size != _count(shape, values.size):
        raise CalibrationError(f"is damaged: {values.size} numbers in an array of shape {shape}")
    return values.reshape(shape, order="F")


def _count(shape: tuple[int, ...], limit: int) -> int:
    """Product of the sizes, which must not exceed what the data can hold."""
    count = 1
    for size in shape:
        count *= size
        if count > max(limit, 1):
            raise CalibrationError(f"is damaged: an array of shape {shape[:4]} in {limit} bytes")
    return count if shape else 0


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("latin-1")


def _characters(kind: int, payload: bytes, order: str) -> str:
    encoding = ENCODINGS.get(kind) or ("utf-16" if kind == 4 else "latin-1")
    if encoding in ("utf-16", "utf-32"):
        encoding += "-le" if order == "<" else "-be"
    return payload.decode(encoding, errors="replace")
