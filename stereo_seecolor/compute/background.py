"""Work beside the main thread, such as answering a browser while pairs are processed."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def in_background(work: Callable[[], None], stop: Callable[[], None]) -> Iterator[None]:
    """``work`` runs in a thread of its own while the block does; ``stop`` makes it return. It never keeps the program alive."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop()
        thread.join(timeout=5)
