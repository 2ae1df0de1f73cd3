"""NumPy's .npz and .npy: arrays of numbers. Pickles, which can run code, are never read."""

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from calibration.errors import CalibrationError
from calibration.quiet import ignored_warnings

MAX_ARRAYS = 100  # a rig is some ten arrays
MAX_ARRAY_BYTES = 2**20  # corners of 300 views are 0.3 MB
MAX_BYTES = MAX_ARRAYS * MAX_ARRAY_BYTES
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
def damage_named(kinds: tuple[type[Exception], ...] = DAMAGED) -> Iterator[None]:
    """Raise CalibrationError for what NumPy and zipfile raise of damaged files."""
    try:
        yield
    except CalibrationError:
        raise
    except kinds as error:
        raise CalibrationError(
            f"is damaged: {' '.join(str(error).split())[:200] or type(error).__name__}"
        ) from error


def read_npz(raw: bytes, most_bytes: int = MAX_ARRAY_BYTES) -> dict[str, Any]:
    """Name -> array, each of at most ``most_bytes``.

    Raises CalibrationError for what is damaged, too large, or no array of numbers.
    """
    with damage_named(), zipfile.ZipFile(io.BytesIO(raw)) as archive:
        if not any(info.filename.endswith(".npy") for info in archive.infolist()):
            names = ", ".join(info.filename for info in archive.infolist() if not info.is_dir())
            raise CalibrationError(
                f"is an archive ({names[:120]}): unpack it, and give the calibration in it"
            )
        members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if len(members) > MAX_ARRAYS:
            raise CalibrationError(f"holds {len(members)} arrays, which no calibration does")
        _refuse_large(sum(info.file_size for info in members), max(most_bytes, MAX_BYTES))
        return {
            info.filename.removesuffix(".npy"): _array(archive, info, most_bytes)
            for info in members
        }


def read_one(raw: bytes, most_bytes: int = MAX_ARRAY_BYTES) -> dict[str, Any]:
    """The array of a .npy, which its file's name names."""
    with damage_named():
        return {"matrix": _parsed("its array", raw, most_bytes)}


def _refuse_large(size: int, most_bytes: int, name: str = "") -> None:
    if size > most_bytes:
        raise CalibrationError(f"{name}holds more than {most_bytes >> 20} MB: not read")


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, most_bytes: int) -> Any:
    _refuse_large(info.file_size, most_bytes, f"{info.filename}: ")
    with archive.open(info) as file:
        return _parsed(info.filename, file.read(most_bytes + 1), most_bytes)


def _parsed(name: str, content: bytes, most_bytes: int) -> Any:
    _refuse_large(len(content), most_bytes, f"{name}: ")
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    header = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    with ignored_warnings(UserWarning):  # files written by Python 2, as VIAME's are, say "3L" for 3
        shape, fortran, dtype = header(stream)
    if dtype.hasobject:
        raise CalibrationError(
            f"{name}: holds Python objects instead of numbers, which could run code: save plain "
            "arrays"
        )
    data = memoryview(content)[stream.tell() :]
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(data):
        raise CalibrationError(
            f"{name}: is damaged: {len(data)} bytes for an array of shape {shape}"
        )
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
