"""Calls a function at intervals, in a thread of its own."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def heartbeat(beat: Callable[[], bool], every_s: float) -> Iterator[None]:
    """Call ``beat`` every ``every_s`` seconds while the block runs, until it returns False."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(every_s) and beat():
            pass

    thread = threading.Thread(target=run, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
