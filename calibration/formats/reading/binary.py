"""Binary calibration files as keys and values: MATLAB's .mat, NumPy's .npz and .npy.

Numbers are read and nothing else: no pickle, no code, nothing larger than a calibration can be.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from calibration.errors import CalibrationError
from calibration.formats.reading.mat73_files import read_mat73
from calibration.formats.reading.mat_files import (
    HEADER_BYTES,
    MAX_INFLATED_BYTES,
    Mat5Reader,
    Opaque,
    byte_order,
)
from calibration.formats.reading.mat_objects import ObjectTable, subsystem_cells
from calibration.formats.reading.numpy_files import read_npz, read_one
from calibration.formats.reading.section import Section

MAX_BYTES = 8 * 2**20  # MATLAB keeps every reprojection error: 0.1 MB for 50 views of 100 corners


PICKLES = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05", b"(dp0\n")
"""Begins of pickles."""


def is_binary(path: Path) -> bool:
    """Whether the file begins as one of these formats do. Raises OSError if it cannot be read."""
    with path.open("rb") as file:
        start = file.read(HEADER_BYTES)
    return start.startswith(PICKLES) or _array_reader(start) is not None


def load_binary(path: Path) -> Section:
    """Read ``path`` into a Section, its values still unchecked.

    Raises CalibrationError if the file is too large, damaged, or needs a missing package.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise CalibrationError(
                f"is larger than {MAX_BYTES >> 20} MB, which no calibration is: is it the right "
                "file?"
            )
        raw = path.read_bytes()
        if raw.startswith(PICKLES):
            raise CalibrationError(
                "holds Python objects, which could run code: save K1, D1, K2, D2, R, T by "
                "numpy.savez"
            )
        read = _array_reader(raw[:HEADER_BYTES])
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


def _read_mat5(raw: bytes, most_bytes: int = MAX_INFLATED_BYTES) -> dict[str, Any]:
    if len(raw) < HEADER_BYTES:
        raise CalibrationError("is truncated: it is shorter than the header of a MAT-file")
    variables = dict(Mat5Reader(raw, byte_order(raw[126:128]), most_bytes).variables(HEADER_BYTES))
    subsystem = variables.pop("", None)
    if any(isinstance(value, Opaque) for value in variables.values()):
        if subsystem is None or not hasattr(subsystem, "tobytes"):
            raise CalibrationError("is truncated or damaged: the part with its objects is missing")
        objects = ObjectTable.of(subsystem_cells(subsystem.tobytes()))
        variables = {name: objects.resolve(value) for name, value in variables.items()}
    return variables
