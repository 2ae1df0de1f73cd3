"""Keep what libraries in C write to standard error, such as libpng's and OpenCV's warnings, off the terminal."""

import contextlib
import io
import os
import sys
from collections.abc import Iterator

STDERR = 2


@contextlib.contextmanager
def quiet_libraries() -> Iterator[None]:
    """Send file descriptor 2 to the null device; Python's own ``sys.stderr`` goes where it went before.

    Damaged images are named by this program, in its own words. Where standard error is closed, nothing is done.
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
            sys.stderr = open(kept, "w", encoding=before.encoding, errors=before.errors, buffering=1, closefd=False)  # noqa: SIM115
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
    """Not so where a test or a notebook has put a stream of its own in its place."""
    try:
        return isinstance(stream, io.TextIOWrapper) and stream.fileno() == STDERR
    except (OSError, ValueError):
        return False
