"""Text for stdout and stderr: lines and tables, on any terminal, without C libraries' messages."""

import contextlib
import io
import os
import sys
from typing import TextIO

from stereo_seecolor.errors import OutputError, printable_lines


def prepare_streams() -> None:
    """Escape characters that a terminal cannot show, and replace a closed stream by os.devnull."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 (lives as long as the process)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def write_out(text: str) -> None:
    """Write to standard output at once, without control characters of names and files.

    Raises OutputError where that fails, BrokenPipeError where the reader has closed it.
    """
    try:
        sys.stdout.write(printable_lines(text))
        sys.stdout.flush()
    except BrokenPipeError:
        discard(sys.stdout)
        raise
    except OSError as error:
        discard(sys.stdout)
        raise OutputError(
            f"standard output cannot be written: {error.strerror or error}: free disk space, or "
            "redirect it"
        ) from error


def write_error(text: str) -> None:
    """Write to standard error at once; errors are ignored."""
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(printable_lines(text))
        sys.stderr.flush()


def discard(stream: TextIO) -> None:
    """Drop what a stream's buffer holds, so that the interpreter does not fail on it at exit."""
    with contextlib.suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
