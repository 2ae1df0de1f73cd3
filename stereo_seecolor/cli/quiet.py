"""Suppresses messages that C libraries, such as libpng and OpenCV, write to standard error."""

import contextlib
import io
import os
import sys
from collections.abc import Iterator

STDERR = 2


@contextlib.contextmanager
def quiet_libraries() -> Iterator[None]:
    """Redirect file descriptor 2 to the null device; Python's own ``sys.stderr`` still writes to
    standard error.

    This program itself names damaged images. Does nothing where standard error is closed.
    """
    try:
        kept = os.dup(STDERR)
    except OSError:
        yield
        return
    before = sys.stderr
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        if _is_standard_error(before):
            before.flush()
            sys.stderr = open(  # noqa: SIM115
                kept,
                "w",
                encoding=before.encoding,
                errors=before.errors,
                buffering=1,
                closefd=False,
            )
        os.dup2(null, STDERR)
        yield
    finally:
        with contextlib.suppress(OSError, ValueError):  # a full device
            sys.stderr.flush()
        sys.stderr = before
        os.dup2(kept, STDERR)
        os.close(kept)
        os.close(null)


def _is_standard_error(stream: object) -> bool:
    """False where a test or a notebook has replaced the stream by its own."""
    try:
        return isinstance(stream, io.TextIOWrapper) and stream.fileno() == STDERR
    except (OSError, ValueError):
        return False
