"""Runs work in threads: on many pairs at once, with results in order; on parts of one image."""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from pathlib import Path

from stereo_seecolor.compute.interface import Item, Result, Usage

Lock = threading.Lock


class Threads:
    """The ``Compute`` of one machine: ``workers`` threads, two items each under way."""

    def __init__(self, workers: int) -> None:
        self._workers = workers

    @property
    def usage(self) -> Usage:
        """The number of cores; threads use the resources of this process."""
        return Usage(min(self._workers, cores()))

    @property
    def parts(self) -> int:
        """1: work that uses all cores is not cut."""
        return 1

    def each(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every item, in order. Closing the iterator finishes what is under way."""
        waiting: deque[Future[Result]] = deque()
        with ThreadPoolExecutor(self._workers) as pool:
            try:
                for item in items:
                    waiting.append(pool.submit(work, item))
                    if len(waiting) >= 2 * self._workers:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)

    @contextmanager
    def sharing(self, folder: Path, inputs: Sequence[Path]) -> Iterator[None]:
        """Do nothing: threads see the same files."""
        yield

    def tiles(self, work: Callable[[Item], Result], tiles: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every tile, one by one: each fills the memory, and uses all cores."""
        return map(work, tiles)


_limit: list[int] = []


def cores() -> int:
    """Number of cores that this process may use."""
    found = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    return min([found, *_limit])


def limit_cores(most: int) -> None:
    """Use at most so many cores from now on for the parts of one image."""
    _limit[:] = [most]
    core_pool.cache_clear()


@cache
def core_pool() -> ThreadPoolExecutor:
    """A pool with a thread for each core, for the parts of one image; one pool for all pairs, so
    that they share the cores.

    Work in it must not wait for other work in it.
    """
    return ThreadPoolExecutor(cores(), "core")


@contextmanager
def in_background(work: Callable[[], Result]) -> Iterator[Future[Result]]:
    """Do ``work`` on another core while the block runs; both are done at the end."""
    under_way = core_pool().submit(work)
    try:
        yield under_way
    finally:
        wait([under_way])


def in_parts(work: Callable[[int, int], None], count: int, least: int = 1) -> None:
    """Call ``work(a, b)`` for parts of ``count`` items, from a to before b: one for each core, with
    at least ``least`` items.
    """
    parts = max(1, min(cores(), count // least))
    bounds = list(pairwise(count * i // parts for i in range(parts + 1)))
    others = [core_pool().submit(work, *part) for part in bounds[1:]]
    work(*bounds[0])
    for other in others:
        other.result()


if hasattr(os, "register_at_fork"):
    # a child has none of its parent's threads
    os.register_at_fork(after_in_child=core_pool.cache_clear)


class Clock:
    """Measures the seconds of each stage of one pair."""

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
