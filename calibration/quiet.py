"""Warnings that libraries give of damaged files, which are judged elsewhere."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

_FILTERS = RLock()


@contextmanager
def ignored_warnings(category: type[Warning] = Warning) -> Iterator[None]:
    """Ignore warnings of a category inside.

    Python's filters belong to the process: of two threads that replace and restore them at the same
    time, one restores those of the other. So one thread at a time does; keep the inside short.
    """
    with _FILTERS, warnings.catch_warnings():
        warnings.simplefilter("ignore", category)
        yield
