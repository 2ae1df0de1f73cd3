"""Runs work beside the main thread: answers a browser, writes a pair while the next is made."""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

MOST_WAITING = 2
"""Most pieces of work that wait or are under way: the caller waits before it adds another."""
MOST_FLUSHED = 8
"""Most files that are flushed to a disk at the same time."""
NICE = 10
"""Steps of priority below the main thread, whose work is urgent."""


@contextmanager
def running(work: Callable[[], None], stop: Callable[[], None]) -> Iterator[None]:
    """Run ``work`` in a thread of its own while the block runs; ``stop`` makes it return. It never
    keeps the program alive.
    """
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop()
        thread.join(timeout=5)


@contextmanager
def heartbeat(beat: Callable[[], bool], every_s: float) -> Iterator[None]:
    """Call ``beat`` every ``every_s`` seconds while the block runs, until it returns False."""
    ended = threading.Event()

    def beats() -> None:
        while not ended.wait(every_s) and beat():
            pass

    with running(beats, ended.set):
        yield


class WorkBehind:
    """Does work in order, in one thread of low priority, while the caller goes on.

    An error of a piece of work is raised by the next ``put``, or by ``finish``.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "behind", initializer=_yield_to_others)
        self._waiting: deque[Future[None]] = deque()

    def put(self, work: Callable[[], None]) -> None:
        """Add a piece of work; waits while ``MOST_WAITING`` pieces are not done."""
        while self._waiting and (self._waiting[0].done() or len(self._waiting) >= MOST_WAITING):
            self._waiting.popleft().result()
        self._waiting.append(self._pool.submit(work))

    def finish(self) -> None:
        """Wait until all work is done."""
        try:
            while self._waiting:
                self._waiting.popleft().result()
        finally:
            self._pool.shutdown(wait=True, cancel_futures=True)


class Alongside:
    """Does work that waits for a disk, each piece in its thread, while the caller goes on."""

    def __init__(self) -> None:
        self._under_way: list[Future[None]] = []

    def put(self, work: Callable[[], None]) -> None:
        """Begin a piece of work."""
        self._under_way.append(_waiting_pool().submit(work))

    def finish(self) -> None:
        """Wait until all work is done; raises the first error."""
        wait(self._under_way)
        for done in self._under_way:
            done.result()


@cache
def _waiting_pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(MOST_FLUSHED, "flush")


if hasattr(os, "register_at_fork"):
    # a child has none of its parent's threads
    os.register_at_fork(after_in_child=_waiting_pool.cache_clear)


def _yield_to_others() -> None:
    with suppress(AttributeError, OSError):  # systems without priorities of threads
        os.setpriority(
            os.PRIO_PROCESS, threading.get_native_id(), os.getpriority(os.PRIO_PROCESS, 0) + NICE
        )


def pin(most: int) -> tuple[int, ...]:
    """Restrict this process and all its threads to ``most`` processors; returns their numbers, ()
    where the system cannot.
    """
    if not hasattr(os, "sched_setaffinity"):
        return ()
    chosen = sorted(os.sched_getaffinity(0))[:most]
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):
            os.sched_setaffinity(int(thread.name), chosen)
    return tuple(chosen)
