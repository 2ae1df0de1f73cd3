"""Atomic writes: files are complete or not there at all, also after a kill or a loss of power.

Content goes to a temporary file beside its destination, is flushed to disk, and is renamed into
place; then the folder is flushed.
"""

import contextlib
import itertools
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from calibration.files import flush, flush_folder
from stereo_seecolor.errors import OutputError

TEMPORARY_PREFIX = ".writing-"
_OWN = re.compile(
    r"\.writing-(?:[0-9a-f]{6}\d+-\d+-.+|(?:probe|work)-[0-9a-f]{8,}|[0-9a-f]{32,}\.npy)", re.S
)
"""Names of temporary files: of ``temporary_path``, and of files that several processes find by
their names. A user's differ.
"""

_numbers = itertools.count()
_process = secrets.token_hex(3)
"""Process numbers of two machines that write into one folder can be the same."""

Content = bytes | memoryview | Iterable[bytes | memoryview]


def write_atomic(path: Path, content: Content) -> None:
    """Write ``content``, in one piece or in several, to ``path``; makes the folder if need be.

    Raises OutputError if the disk is full or the folder cannot be written; what was at ``path`` is
    then still there.
    """
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.writelines(_pieces(content))


def write_replaceable(path: Path, content: Content) -> None:
    """Write a file as ``write_atomic`` does, but without waiting for the disk: for files that show
    by themselves whether they are complete, and can be made again.
    """
    with output_errors(path):
        move_into_place(write_temporary(path, content), path)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path to write to, for libraries that write files themselves; it becomes ``path``
    when the block ends well.

    Raises OutputError where the file cannot be written; OSErrors inside become one.
    """
    temporary = temporary_path(path)
    with output_errors(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            flush_file(temporary)
            move_into_place(temporary, path)
            flush_folder(path.parent)
        except BaseException:
            remove(temporary)
            raise


@contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """Turn an OSError of the block into an OutputError that names ``path``."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror or error}: free disk space and run "
            "again, finished results are kept"
        ) from error


def holds(path: Path, content: Content) -> bool:
    """Whether the file at ``path`` has this content. Raises OSError where it cannot be read."""
    with path.open("rb") as file:
        return all(file.read(len(one)) == one for one in _pieces(content)) and not file.read(1)


def _pieces(content: Content) -> Iterable[bytes | memoryview]:
    return [content] if isinstance(content, bytes | memoryview) else content


def write_temporary(path: Path, content: Content) -> Path:
    """Write ``content`` beside ``path``, to be flushed, and return where; nothing is left there on
    an error. Raises OSError.
    """
    temporary = temporary_path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with temporary.open("wb") as file:
            file.writelines(_pieces(content))
    except BaseException:
        remove(temporary)
        raise
    return temporary


def move_into_place(temporary: Path, path: Path) -> None:
    """Rename a temporary file; it is removed where that fails. Raises OSError."""
    try:
        temporary.replace(path)
    except OSError:
        remove(temporary)
        raise


def temporary_path(path: Path) -> Path:
    """A name beside ``path`` that no other process or thread uses; always short."""
    return path.with_name(
        f"{TEMPORARY_PREFIX}{_process}{os.getpid()}-{next(_numbers)}-{path.name[-40:]}"
    )


def temporaries_of(path: Path) -> list[Path]:
    """Temporary files and folders begun for ``path``, by any process; no links."""
    ending = f"-{path.name[-40:]}"
    found = path.parent.glob(f"{TEMPORARY_PREFIX}*") if path.parent.is_dir() else ()
    return [
        one
        for one in found
        if one.name.endswith(ending) and _OWN.fullmatch(one.name) and not one.is_symlink()
    ]


def flush_file(temporary: Path) -> None:
    """Flush a written file to disk; it is removed where that fails. Raises OSError."""
    try:
        flush(temporary)
    except OSError:
        remove(temporary)
        raise


def remove_leftovers(folder: Path) -> None:
    """Delete what a killed run left in ``folder`` itself; links are never followed."""
    if not folder.is_dir() or folder.is_symlink():
        return
    for leftover in folder.glob(f"{TEMPORARY_PREFIX}*"):
        if _OWN.fullmatch(leftover.name):
            remove(leftover)


def remove_leftovers_below(folder: Path) -> None:
    """Do as ``remove_leftovers`` in a folder and in all folders below it."""
    if folder.is_symlink():
        return
    for root, _, _ in os.walk(folder, followlinks=False):
        remove_leftovers(Path(root))


def files_below(folder: Path) -> Iterable[Path]:
    """List all files and links below a folder, without following links."""
    for root, folders, names in os.walk(folder, followlinks=False):
        links = [name for name in folders if (Path(root) / name).is_symlink()]
        yield from (Path(root) / name for name in (*names, *links))


def remove(path: Path) -> None:
    """Delete a temporary file or folder if it can be: errors here must not hide the first one."""
    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
