"""Signals that ask a program to end: Ctrl-C, SIGTERM (time limit of a batch system) and SIGHUP (a
terminal was closed).

The first lets a command finish the pairs under way and give OUT back. A second Ctrl-C ends it at
once; the other signals come twice by themselves, and SIGKILL follows. The exit code is always 130:
what is done is kept, and the same line goes on.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_INTERRUPTED = 130
SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
SHOW_CURSOR = "\x1b[?25h"  # a progress bar hides it
FIRST = (
    "\nstereo-seecolor: stopping when the current pairs are finished; Ctrl-C again stops "
    "immediately\n"
)
SECOND = "\nstereo-seecolor: stopped immediately\n"


@contextmanager
def interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the first signal; end the process at a second Ctrl-C.

    Output files are complete even then, because each is written under another name first. Does
    nothing outside the main thread, nor for a signal that is ignored, as Ctrl-C is in the
    background of a shell script, and SIGHUP below nohup.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: signal.getsignal(number)
        for number in SIGNALS
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            if number != signal.SIGINT:
                return
            _tell(SECOND + (SHOW_CURSOR if sys.stderr.isatty() else ""))
            os._exit(EXIT_INTERRUPTED)
        interrupted = True
        # the interpreter, when it ends, gives each handler's signal its default action: to kill
        for other in before.keys() - {signal.SIGINT}:
            signal.signal(other, signal.SIG_IGN)
        _tell(FIRST)
        raise KeyboardInterrupt

    for number in before:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        # else a second Ctrl-C may still come while the interpreter waits for threads
        if not interrupted:
            for number, handler in before.items():
                signal.signal(number, handler)


def _tell(text: str) -> None:
    """Write to standard error without its buffer, which the interrupted code may be writing to."""
    with contextlib.suppress(OSError, ValueError):
        os.write(sys.stderr.fileno(), text.encode())
