"""Atomic writes: a file is complete and on disk, or not there at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def write_atomic(path: Path) -> Iterator[Path]:
    """A temporary path of the same suffix, in the same folder, that becomes ``path`` when the block
    ends without an error.

    Folders above are made. File and folder are flushed to disk (fsync) before and after the rename,
    so that neither a kill nor a loss of power leaves half a file. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}{path.suffix}")
    try:
        yield temporary
        flush(temporary)
        temporary.replace(path)
        flush_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def flush_folder(folder: Path) -> None:
    """Flush a folder's entries to disk, where the system can."""
    if os.name == "nt":  # Windows cannot open folders, and flushes renames itself
        return
    with suppress(OSError):  # some network file systems refuse
        flush(folder)


def flush(path: Path) -> None:
    """Flush a file or a folder to disk. Raises OSError."""
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
