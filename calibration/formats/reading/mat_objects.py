"""Objects of MATLAB's classes, which a MAT-file keeps in a subsystem of its own ("MCOS").

MathWorks does not document it. As found in files of R2016b to R2022b: a cell array whose first
cell is a table of 32-bit numbers and names, whose second is empty, and whose further cells are
values. The table says of each object its class, and of each of its properties the number of a name
and of a value. Classes that have a ``saveobj`` keep its result as the one property "any".
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.formats.reading.mat_files import Mat5Reader, Opaque, byte_order

REFERENCE = 0xDD000000  # the first number of an array that stands for an object
MCOS_MAX_DEPTH = 10  # objects in objects; real files have fewer
MAX_NAMES = 10_000  # of classes and fields; real files have fewer
Words = NDArray[np.uint32]


def subsystem_cells(raw: bytes) -> Sequence[Any]:
    """The cells of the subsystem that is the last, nameless variable of a Level 5 file."""
    reader = Mat5Reader(raw, byte_order(raw[2:4]))
    for _, value in reader.variables(8):
        wrapper = value.get("MCOS") if isinstance(value, dict) else None
        if isinstance(wrapper, Opaque) and isinstance(wrapper.reference, list):
            return wrapper.reference
    raise CalibrationError("is damaged: the part that should hold its objects does not")


@dataclass(frozen=True)
class ObjectTable:
    """The objects of a subsystem. names: of properties and classes; objects: (n, 6)."""

    names: list[str]
    objects: Words
    saved: list[Words]
    plain: list[Words]
    cells: Sequence[Any]

    @classmethod
    def of(cls, cells: Sequence[Any]) -> "ObjectTable":
        """Parse the subsystem's cells. Raises CalibrationError if they are not as expected."""
        if len(cells) < 3 or not isinstance(cells[0], np.ndarray) or cells[0].size < 40:
            raise CalibrationError("is damaged: the table of its objects is missing")
        raw = cells[0].astype(np.uint8).ravel(order="F").tobytes()
        words = np.frombuffer(raw[: len(raw) // 4 * 4], "<u4")
        count, offsets = int(words[1]), [int(offset) for offset in words[2:8]]
        if (
            not 40 <= offsets[0] <= len(raw)
            or offsets[:5] != sorted(offsets[:5])
            or offsets[4] > len(raw)
            or count > MAX_NAMES
        ):
            raise CalibrationError(
                "is damaged, or from an unknown MATLAB version: its table of objects is invalid"
            )
        names = [
            name.decode("utf-8", "replace") for name in raw[40 : offsets[0]].split(b"\0")[:count]
        ]
        parts = [
            np.frombuffer(raw[start : start + (end - start) // 4 * 4], "<u4")
            for start, end in pairwise(offsets)
        ]
        objects = parts[2][: len(parts[2]) // 6 * 6].reshape(-1, 6)
        return cls(names, objects, list(_blocks(parts[1])), list(_blocks(parts[3])), cells[2:])

    def resolve(self, value: Any, depth: int = 0) -> Any:
        """``value`` with every reference to an object replaced by the dict of its properties."""
        if depth > MCOS_MAX_DEPTH:
            raise CalibrationError("is damaged: objects within objects without end")
        if isinstance(value, Opaque):
            return self.resolve(value.reference, depth + 1)
        if isinstance(value, dict):
            return {key: self.resolve(inner, depth + 1) for key, inner in value.items()}
        if (
            isinstance(value, np.ndarray)
            and value.dtype.kind == "u"
            and value.size >= 6
            and value.flat[0] == REFERENCE
        ):
            return self._object(int(value.ravel(order="F")[-2]), depth)
        return value

    def _object(self, number: int, depth: int) -> Any:
        if not 0 < number < len(self.objects):
            raise CalibrationError(f"is damaged: it names object {number} of {len(self.objects)}")
        saved, plain = int(self.objects[number, 3]), int(self.objects[number, 4])
        blocks, block = (self.saved, saved) if saved else (self.plain, plain)
        if not 0 <= block < len(blocks):
            raise CalibrationError("is damaged: an object without properties")
        properties = {
            self._name(name): self._value(kind, value, depth)
            for name, kind, value in blocks[block].tolist()
        }
        return properties["any"] if list(properties) == ["any"] else properties

    def _name(self, number: int) -> str:
        if not 0 < number <= len(self.names):
            raise CalibrationError("is damaged: a property without a name")
        return self.names[number - 1]

    def _value(self, kind: int, value: int, depth: int) -> Any:
        if kind == 0:
            return self._name(value)
        if kind == 2:
            return bool(value)
        if not 0 <= value < len(self.cells):
            raise CalibrationError("is damaged: a property without a value")
        return self.resolve(self.cells[value], depth + 1)


def _blocks(words: Words) -> Iterator[Words]:
    """(n, 3) name, kind and value of each object's properties; each block fills whole 8 bytes."""
    position = 0
    while position < len(words):
        end = position + 1 + 3 * int(words[position])
        if end > len(words):
            raise CalibrationError("is damaged: properties beyond the end of their table")
        yield words[position + 1 : end].reshape(-1, 3)
        position = end + end % 2
