"""Arrays in files: as they are in memory, and numpy's own.

Headers of numpy are parsed by one thread at a time. Python 3.11 counts the depth of its parser for
all threads together: where the collector of garbage lets another thread go on in the middle of a
header, both end with "SystemError: AST constructor recursion depth mismatch".
"""

import contextlib
import mmap
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.files.atomic import temporary_path

ALIGNMENT = 64
"""Of each array in its file, bytes: a line of the processor's cache."""
PARSING = Lock()
"""Held while a header is parsed."""


def write_arrays(path: Path, arrays: Sequence[NDArray[Any]]) -> None:
    """Write arrays to one file, completely or not at all; its folder must exist."""
    temporary = temporary_path(path)
    with contextlib.suppress(OSError):
        try:
            with temporary.open("wb") as file:
                for array in arrays:
                    file.write(bytes(-file.tell() % ALIGNMENT))
                    np.save(file, array)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def read_arrays(path: Path, count: int) -> list[NDArray[Any]] | None:
    """Read the ``count`` arrays of a file; None where it is missing or truncated.

    They lie in the system's cache of the file, and are read from disk where they are used: a pass
    that looks at a part of a picture costs no more than that. The file may be deleted, not cut,
    while they are in use; what is written into them stays in memory.
    """
    try:
        with path.open("rb") as file:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
        return [_next(content) for _ in range(count)]
    except (OSError, ValueError, TypeError):
        return None


def _next(content: mmap.mmap) -> NDArray[Any]:
    """The array at the next multiple of ALIGNMENT. Raises ValueError or TypeError without."""
    content.seek(content.tell() + -content.tell() % ALIGNMENT)
    npy.read_magic(content)
    with PARSING:
        shape, by_columns, dtype = npy.read_array_header_1_0(content)
    array: NDArray[Any] = np.ndarray(
        shape, dtype, content, content.tell(), order="F" if by_columns else "C"
    )
    content.seek(array.nbytes, os.SEEK_CUR)
    return array


def load_array(path: Path) -> NDArray[Any]:
    """The array of a ``.npy`` file. Raises OSError, and ValueError where it is cut."""
    with PARSING:
        array: NDArray[Any] = np.load(path)
    return array


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an ``.npz`` file by name. Raises OSError, ValueError, zipfile.BadZipFile."""
    with PARSING, path.open("rb") as file, np.load(file) as content:
        return dict(content)
