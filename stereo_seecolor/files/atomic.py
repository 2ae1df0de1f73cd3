"""Files that are whole or not there at all."""

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path

from stereo_seecolor.errors import OutputError

TEMPORARY_PREFIX = ".writing-"


def write_atomic(path: Path, content: bytes | memoryview | Iterator[bytes]) -> None:
    """Write ``content``, whole or piece by piece, under a temporary name beside ``path``, then rename.

    So a kill at any instant leaves whole files only. Makes the folder if need be.
    Raises OutputError if the disk is full or the place cannot be written.
    """
    temporary = path.with_name(f"{TEMPORARY_PREFIX}{os.getpid()}-{threading.get_ident()}-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            file.writelines(content if isinstance(content, Iterator) else [content])
        temporary.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise OutputError(
            f"{path}: cannot be written: {error.strerror or error}: free the place and run again, what is done is kept"
        ) from error


def remove_leftovers(root: Path) -> None:
    """Delete the temporary files that a killed run left below ``root``."""
    for leftover in root.rglob(f"{TEMPORARY_PREFIX}*"):
        leftover.unlink(missing_ok=True)
