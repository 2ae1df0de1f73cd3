"""Binary calibration files as keys and values: MATLAB's .mat, NumPy's .npz and .npy."""

import io
import math
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from calibration.errors import CalibrationError
from calibration.formats.reading.mat_files import (
    HEADER_BYTES,
    MAT5_MAX_DEPTH,
    MAX_ELEMENTS,
    MAX_INFLATED_BYTES,
    Mat5Reader,
    ObjectTable,
    Opaque,
    byte_order,
    subsystem_cells,
)
from calibration.formats.reading.section import Section

# NumPy's .npz and .npy: arrays of numbers. Arrays of Python objects (pickles, which can run code)
# are never read.

MAX_ARRAYS = 100  # a rig is some ten arrays
MAX_ARRAY_BYTES = 2**20  # corners of 300 views are 0.3 MB
DAMAGED = (
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    OverflowError,
    SyntaxError,
)


@contextmanager
def _damage_named() -> Iterator[None]:
    """Raise CalibrationError for what NumPy and zipfile raise of damaged files."""
    try:
        yield
    except CalibrationError:
        raise
    except DAMAGED as error:
        raise CalibrationError(
            f"is damaged: {' '.join(str(error).split())[:200] or type(error).__name__}"
        ) from error


def read_npz(raw: bytes, most_bytes: int = MAX_ARRAY_BYTES) -> dict[str, Any]:
    """Name -> array, each of at most ``most_bytes``.

    Raises CalibrationError for what is damaged, too large, or no array of numbers.
    """
    with _damage_named(), zipfile.ZipFile(io.BytesIO(raw)) as archive:
        if not any(info.filename.endswith(".npy") for info in archive.infolist()):
            names = ", ".join(info.filename for info in archive.infolist() if not info.is_dir())
            raise CalibrationError(
                f"is an archive ({names[:120]}): unpack it, and give the calibration in it"
            )
        members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if len(members) > MAX_ARRAYS:
            raise CalibrationError(f"holds {len(members)} arrays, which no calibration does")
        return {
            info.filename.removesuffix(".npy"): _array(archive, info, most_bytes)
            for info in members
        }


def read_one(raw: bytes, most_bytes: int = MAX_ARRAY_BYTES) -> dict[str, Any]:
    """The array of a .npy, which its file's name names."""
    with _damage_named():
        return {"matrix": _parsed("its array", raw, most_bytes)}


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, most_bytes: int) -> Any:
    with archive.open(info) as file:
        return _parsed(info.filename, file.read(most_bytes + 1), most_bytes)


def _parsed(name: str, content: bytes, most_bytes: int) -> Any:
    if len(content) > most_bytes:
        raise CalibrationError(
            f"{name}: holds more than {most_bytes >> 20} MB, which no calibration does"
        )
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    header = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    with warnings.catch_warnings():
        # files written by Python 2, as VIAME's are, say "3L" for 3
        warnings.simplefilter("ignore", UserWarning)
        shape, fortran, dtype = header(stream)
    if dtype.hasobject:
        raise CalibrationError(
            f"{name}: holds Python objects instead of numbers, which could run code: save plain "
            "arrays"
        )
    data = content[stream.tell() :]
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(data):
        raise CalibrationError(
            f"{name}: is damaged: {len(data)} bytes for an array of shape {shape}"
        )
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")


# MATLAB's version 7.3 MAT-file, which is HDF5 with attributes of its own; read with h5py, an
# optional package.
#
# Optional because ``save`` writes 7.3 only when told to, and because the HDF5 library is large
# and written in C: who has no such file need not trust it.

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
    try:
        with h5py.File(io.BytesIO(raw), "r") as file:
            return _variables(_Mat73(file, most_bytes))
    except CalibrationError:
        raise
    except Exception as error:
        # h5py raises whatever the damage leads to: OSError, KeyError, RuntimeError, UnicodeError
        # ...
        raise CalibrationError(
            f"is damaged: {' '.join(str(error).split())[:200] or type(error).__name__}"
        ) from error


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
        return Opaque("MCOS", kind, array) if "MATLAB_object_decode" in node.attrs else array

    def cells(self, node: Any, depth: int) -> list[Any]:
        if math.prod(node.shape) > MAX_ELEMENTS:
            raise CalibrationError("holds a cell array that no calibration has")
        return [self.value(self.file[reference], depth + 1) for reference in np.ravel(node[()])]


# Binary calibration files as keys and values: MATLAB's .mat, NumPy's .npz and .npy.
#
# Numbers are read and nothing else: no pickle, no code, nothing larger than a calibration can be.

MAX_BYTES = 8 * 2**20  # MATLAB keeps every reprojection error: 0.1 MB for 50 views of 100 corners


PICKLES = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05", b"(dp0\n")
"""Begins of pickles."""


def is_binary(path: Path) -> bool:
    """Tell whether the file begins as one of these formats do. Raises OSError if it cannot be
    read.
    """
    with path.open("rb") as file:
        return _reader(file.read(HEADER_BYTES)) is not None


def load_binary(path: Path) -> Section:
    """Read ``path`` into a Section, its values still unchecked.

    Raises CalibrationError if the file is too large, damaged, or needs a package that is not
    installed.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise CalibrationError(
                f"is larger than {MAX_BYTES >> 20} MB, which no calibration is: is it the right "
                "file?"
            )
        raw = path.read_bytes()
        read = _reader(raw[:HEADER_BYTES])
        assert read is not None
        return Section(str(path), read(raw))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror or error}") from error
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error


def read_arrays(raw: bytes, most_bytes: int) -> dict[str, Any] | None:
    """Name -> value of all variables of a .mat, .npz or .npy, arrays of at most ``most_bytes``;
    None for any other file.

    Raises CalibrationError as load_binary.
    """
    read = _array_reader(raw[:HEADER_BYTES])
    return read(raw, most_bytes) if read else None


def _array_reader(start: bytes) -> Callable[..., dict[str, Any]] | None:
    if start.startswith(b"MATLAB 7.3"):
        return read_mat73
    if start.startswith(b"MATLAB "):
        return _read_mat5
    if start.startswith(b"PK\x03\x04"):
        return read_npz
    return read_one if start.startswith(b"\x93NUMPY") else None


def _reader(start: bytes) -> Callable[[bytes], dict[str, Any]] | None:
    if read := _array_reader(start):
        return read
    if start.startswith(PICKLES):
        return _refuse_pickle
    return None


def _refuse_pickle(_: bytes) -> dict[str, Any]:
    raise CalibrationError(
        "holds Python objects, which could run code: save K1, D1, K2, D2, R, T by numpy.savez"
    )


def _read_mat5(raw: bytes, most_bytes: int = MAX_INFLATED_BYTES) -> dict[str, Any]:
    if len(raw) < HEADER_BYTES:
        raise CalibrationError("is cut off: it is shorter than the header of a MAT-file")
    variables = dict(Mat5Reader(raw, byte_order(raw[126:128]), most_bytes).variables(HEADER_BYTES))
    subsystem = variables.pop("", None)
    if any(isinstance(value, Opaque) for value in variables.values()):
        if subsystem is None or not hasattr(subsystem, "tobytes"):
            raise CalibrationError(
                "is cut off or damaged: the part that should hold its objects is missing"
            )
        objects = ObjectTable.of(subsystem_cells(subsystem.tobytes()))
        variables = {name: objects.resolve(value) for name, value in variables.items()}
    return variables
