"""Worker processes of this machine, forked from one process that has imported all modules, which
takes each worker 2 s else.

That process, the starter, is forked from the client if the client has only one thread, else started
as a new program, which imports once more. It starts a new worker for one that ends, and ends all
when its pipe from the client closes, however the client ends.
"""

import contextlib
import gc
import importlib
import json
import logging
import os
import select
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from calibration.bounded_text import load_json
from stereo_seecolor.compute.sources import ROOT
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.extras.fleet.cluster.dask_settings import DASK_SETTINGS
from stereo_seecolor.extras.fleet.cluster.run_keys import of_worker

IMPORTED_ONCE = ("distributed", "stereo_seecolor.dive.passes")
"""Modules that all workers need, by name, since they lie in higher layers than this one."""
LOADED_ONCE = ("stereo_seecolor.matching.warm_up:load_search",)
"""Functions that load the machine code that all workers need, in 0.7 s."""
LOOK_S = 0.5
"""Seconds between two checks of the workers."""
THREADS_END_S = 1.0
"""Most seconds to wait for threads to end; the remaining ones, of libraries, are idle."""
CAN_FORK = hasattr(os, "fork")
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Orders:
    """The workers to start: number and scheduler's address. memory_bytes: a worker that takes more
    is ended.

    scratch: a folder for their files. keys: their part of the run's keys, through the pipe alone.
    """

    address: str
    workers: int
    memory_bytes: int
    scratch: str
    keys: dict[str, str]


@contextmanager
def starter() -> Iterator[Callable[[Orders], None]]:
    """A function that starts workers until the block ends. Raises OSError where it cannot."""
    for name in IMPORTED_ONCE:
        importlib.import_module(name)
    orders, end = _forked() if _one_thread() else _started_anew()

    def give(what: Orders) -> None:
        orders.write(json.dumps(asdict(what)).encode() + b"\n")
        orders.flush()

    try:
        yield give
    finally:
        with contextlib.suppress(BrokenPipeError):
            orders.close()
        end()


def _one_thread() -> bool:
    """Whether this process has only one thread, so that it may be forked: a lock held by another
    thread stays locked in a copy.
    """
    try:
        return len(list(Path("/proc/self/task").iterdir())) == 1
    except OSError:  # only Linux says it
        return False


def _forked() -> tuple[BinaryIO, Callable[[], object]]:
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(writing)
        _end_with(lambda: serve(os.fdopen(reading, "rb")))
    os.close(reading)
    return os.fdopen(writing, "wb"), lambda: os.waitpid(pid, 0)


def _started_anew() -> tuple[BinaryIO, Callable[[], object]]:
    # what this process finds, workers must find
    path = os.pathsep.join(filter(None, [str(ROOT), *sys.path]))
    line = f"import sys; from {__name__} import serve; serve(sys.stdin.buffer)"
    started = subprocess.Popen(
        [sys.executable, "-P", "-c", line],
        stdin=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert started.stdin is not None
    return started.stdin, started.wait  # type: ignore[return-value]


def _end_with(work: Callable[[], object]) -> NoReturn:
    """Do ``work`` and end this process, without the exit handlers that it has from its parent."""
    code = 1
    try:
        work()
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(code)


def serve(pipe: BinaryIO) -> None:
    """Keep the number of workers that was ordered through the pipe, until it closes; then end them
    and delete their files.
    """
    # of the terminal or the batch system: the client decides what they mean
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    for name in IMPORTED_ONCE:
        importlib.import_module(name)
    _load()
    content = pipe.readline()
    if not content:
        return
    orders = Orders(**load_json(content))
    running: set[int] = set()
    try:
        while True:
            _replace_lost(running, orders)
            if select.select([pipe], [], [], LOOK_S)[0]:
                return
            _end_large(running, orders.memory_bytes)
    finally:
        for pid in running:
            os.kill(pid, signal.SIGKILL)
        for pid in running:
            os.waitpid(pid, 0)
        shutil.rmtree(orders.scratch, ignore_errors=True)


def _load() -> None:
    for named in LOADED_ONCE:
        module, _, function = named.partition(":")
        getattr(importlib.import_module(module), function)()
    core_pool().shutdown()  # its threads would not be there in a copy of this process
    core_pool.cache_clear()
    _wait_for_threads()
    gc.freeze()  # or the first look for garbage in each worker copies all that it shares


def _wait_for_threads() -> None:
    """Wait until ended threads are gone: they still free OpenCV's data under a lock, which must not
    be held at a fork.
    """
    end_s = time.monotonic() + THREADS_END_S
    while not _one_thread() and time.monotonic() < end_s:
        time.sleep(0.001)


def _replace_lost(running: set[int], orders: Orders) -> None:
    """Start workers for those that have ended. running: their process numbers; changed."""
    running -= {pid for pid in running if os.waitpid(pid, os.WNOHANG)[0]}
    while len(running) < orders.workers:
        pid = os.fork()
        if pid == 0:
            _end_with(lambda: _work(orders))
        running.add(pid)


def _end_large(running: set[int], memory_bytes: int) -> None:
    import psutil  # comes with Dask

    for pid in running:
        with contextlib.suppress(psutil.Error):
            taken = psutil.Process(pid).memory_info().rss
            if taken > memory_bytes:
                os.kill(pid, signal.SIGKILL)
                what = (
                    f"worker {pid} took {taken / 1e9:.2f} GB, more than its "
                    f"{memory_bytes / 1e9:.2f} GB: it was ended"
                )
                log.warning("%s, and another does its batch again", what)


def _work(orders: Orders) -> None:
    import asyncio

    import dask
    from distributed import Worker

    # the client's, where this is a copy of it
    for name in ("distributed", "stereo_seecolor", "calibration"):
        logging.getLogger(name).handlers.clear()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)

    async def served() -> None:
        worker: Any = Worker(
            orders.address,
            nthreads=1,
            host="127.0.0.1",
            memory_limit=0,  # the starter looks after it
            local_directory=orders.scratch,
            death_timeout=60,
            security=of_worker(orders.keys),
        )
        async with worker:
            await worker.finished()

    with dask.config.set(DASK_SETTINGS):
        asyncio.run(served())
