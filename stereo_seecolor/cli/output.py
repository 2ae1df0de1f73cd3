"""Text for standard output and standard error: lines and tables, on any terminal, without the
messages of C libraries.
"""

import contextlib
import io
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import TextIO

from stereo_seecolor.errors import OutputError, printable_lines

# Lines and tables of text without color, the same on a terminal and in a file.

_WIDEST = 10_000
"""Width of a line in characters: more than any table has. At a terminal's width, names of frames
would be cut.
"""


def lines(*texts: str) -> str:
    """The texts, each on a line of its own."""
    return "".join(f"{text}\n" for text in texts)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table without a frame, as wide as its content."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    drawn = Table(*columns, box=None, header_style="")
    for row in rows:
        drawn.add_row(*(Text(cell) for cell in row))
    text = io.StringIO()
    Console(file=text, width=_WIDEST, color_system=None).print(drawn)
    return lines(*(line.rstrip() for line in text.getvalue().splitlines()))


def duration(seconds: float) -> str:
    """A duration as text, in seconds, minutes, hours or days."""
    for unit, length in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s"


# Writes to standard output and standard error: any text on any terminal, with a known error where
# that fails.


def prepare_streams() -> None:
    """Write characters that a terminal cannot show as escapes, and replace a closed stream by the
    null device.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 (lives as long as the process)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def write_out(text: str) -> None:
    """Write to standard output at once, without the control characters that names and files may
    hold.

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
    """Drop what is left in a stream's buffer, so that the interpreter does not fail on it at
    exit.
    """
    with contextlib.suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


# Suppresses messages that C libraries, such as libpng and OpenCV, write to standard error.

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
