"""Arrays written as they are for a later pass of the same command: what is lost or does not fit is made again."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.atomic import temporary_path


def write_arrays(path: Path, arrays: Sequence[NDArray[Any]]) -> None:
    """Write a file of arrays as a whole, or nothing where the disk has no room for it; its folder must be there."""
    temporary = temporary_path(path)
    with contextlib.suppress(OSError):
        try:
            with temporary.open("wb") as file:
                for array in arrays:
                    np.save(file, array)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def read_arrays(path: Path, count: int) -> list[NDArray[Any]] | None:
    """The ``count`` arrays of a file; None where it was never written, or somebody removed or cut it."""
    try:
        with path.open("rb") as file:
            return [np.load(file) for _ in range(count)]
    except (OSError, ValueError, EOFError):
        return None
