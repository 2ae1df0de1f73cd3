"""Work on many pairs at once, and get the results in their order; and the threads among which a stage divides one pair."""

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_order(function: Callable[[Item], Result], items: Iterable[Item], workers: int) -> Iterator[Result]:
    """``function`` of each item, in the items' order, by ``workers`` threads; at most two items a worker are under way.

    Closing the iterator, or an exception, lets what is in hand finish and starts nothing more.
    """
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) >= 2 * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def core_pool() -> ThreadPoolExecutor:
    """A thread a core, for the parts of one image; one pool for all, or many pairs at once would crowd the cores.

    What runs in it must not wait for anything else that does.
    """
    return ThreadPoolExecutor(cores(), "core")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=core_pool.cache_clear)  # a child has none of its parent's threads


class Clock:
    """Seconds a stage, for one pair."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time spent inside the ``with`` block to ``stage``."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start
