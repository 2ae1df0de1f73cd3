"""Ctrl-C: the first lets a command finish the pairs under way, the second ends it at once; the exit code is 130 both times."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_INTERRUPTED = 130
SHOW_CURSOR = "\x1b[?25h"  # a progress bar hides it
FIRST = "\nstereo-seecolor: stopping when the pairs under way are finished; Ctrl-C again stops at once\n"
SECOND = "\nstereo-seecolor: stopped at once\n"


@contextmanager
def interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the first Ctrl-C; end the process at the second.

    Output files are complete even then, because each is written under another name first. Does nothing outside the main thread, or
    where Ctrl-C is ignored, as in a program that a shell script runs in the background.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is signal.SIG_IGN:
        yield
        return
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            _tell(SECOND + (SHOW_CURSOR if sys.stderr.isatty() else ""))
            os._exit(EXIT_INTERRUPTED)
        interrupted = True
        _tell(FIRST)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        if not interrupted:  # else a second Ctrl-C may still come while the interpreter waits for threads
            signal.signal(signal.SIGINT, before)


def _tell(text: str) -> None:
    """Write to standard error without its buffer, which the interrupted code may be writing to."""
    with contextlib.suppress(OSError, ValueError):
        os.write(sys.stderr.fileno(), text.encode())
