"""MATLAB's version 7.3 MAT-file, which is HDF5 with attributes of its own; read with h5py, an
optional package.

Optional because ``save`` writes 7.3 only when told to, and because the HDF5 library is large and
written in C: who has no such file need not trust it.
"""

import io
import math
from typing import Any

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.reading.mat_files import (
    MAT5_MAX_DEPTH,
    MAX_ELEMENTS,
    MAX_INFLATED_BYTES,
    Opaque,
)
from calibration.formats.reading.mat_objects import ObjectTable
from calibration.formats.reading.numpy_files import damage_named

SUBSYSTEM = "#subsystem#/MCOS"


def read_mat73(raw: bytes, most_bytes: int = MAX_INFLATED_BYTES) -> dict[str, Any]:
    """Name -> value of all variables, as ``mat5`` gives them, arrays of at most ``most_bytes``.

    Raises CalibrationError if it is damaged, or h5py is missing.
    """
    try:
        import h5py
    except ImportError as error:
        raise CalibrationError(
            "is a MATLAB 7.3 file, which needs the package h5py: pip install h5py, or save it in "
            "MATLAB with save(..., '-v7')"
        ) from error
    # h5py raises whatever the damage leads to: OSError, KeyError, RuntimeError, UnicodeError ...
    with damage_named((Exception,)), h5py.File(io.BytesIO(raw), "r") as file:
        return _variables(_Mat73(file, most_bytes))


def _variables(reader: "_Mat73") -> dict[str, Any]:
    variables = {
        name: reader.value(node, 0)
        for name, node in reader.file.items()
        if not name.startswith("#")
    }
    if any(isinstance(value, Opaque) for value in variables.values()):
        if SUBSYSTEM not in reader.file:
            raise CalibrationError("is damaged: the part that should hold its objects is missing")
        objects = ObjectTable.of(reader.cells(reader.file[SUBSYSTEM], 0))
        variables = {name: objects.resolve(value) for name, value in variables.items()}
    return variables


class _Mat73:
    """Turns nodes of the file into values, bounded in number, size and depth."""

    def __init__(self, file: Any, most_bytes: int) -> None:
        self.file, self._most_bytes = file, most_bytes
        self._elements = 0

    def value(self, node: Any, depth: int) -> Any:
        self._elements += 1
        if self._elements > MAX_ELEMENTS or depth > MAT5_MAX_DEPTH:
            raise CalibrationError(
                f"holds more than {MAX_ELEMENTS} values or {MAT5_MAX_DEPTH} levels, which no "
                "calibration does"
            )
        if hasattr(node, "keys"):
            return {key: self.value(child, depth + 1) for key, child in node.items()}
        kind = bytes(node.attrs.get("MATLAB_class", b"")).decode("latin-1")
        if "MATLAB_empty" in node.attrs:
            return "" if kind == "char" else np.zeros((0, 0))
        if kind == "cell":
            return self.cells(node, depth)
        if math.prod(node.shape) * node.dtype.itemsize > self._most_bytes:
            raise CalibrationError(
                f"holds an array of shape {node.shape}, which no calibration does"
            )
        array = np.asarray(node[()]).T
        if kind == "char":
            return array.ravel(order="F").astype(np.uint16).tobytes().decode("utf-16-le", "replace")
        return Opaque(array) if "MATLAB_object_decode" in node.attrs else array

    def cells(self, node: Any, depth: int) -> list[Any]:
        if math.prod(node.shape) > MAX_ELEMENTS:
            raise CalibrationError("holds a cell array that no calibration has")
        return [self.value(self.file[reference], depth + 1) for reference in np.ravel(node[()])]
