"""Memory of a Dask scheduler with 200 workers, at the number of batches and the sizes of messages
of a million pairs.

Real: the scheduler, in a process of its own as ``dask scheduler`` starts it, 200 of Dask's workers,
each with its connections, and the program's client, batches, tickets and results. Stands in: the
work, which takes no time and sends back bytes of the true size; and the workers, which are threads
of one process.
"""

import asyncio
import logging
import multiprocessing
import os
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

import psutil
from fleet_kills import scheduler_words

from stereo_seecolor.extras.fleet.cluster import batches
from stereo_seecolor.extras.fleet.cluster.connect import cluster
from stereo_seecolor.inputs.pairing import Pair

PORT, LOOK_S = 18786, 0.2
PAIRS_A_BATCH = 192
"""As ``fleet.py million`` cuts them: 15,400 batches for three passes over a million pairs."""


@dataclass(frozen=True)
class Answers:
    """Work of a pass: so many random bytes for each item, which no compression makes fewer."""

    size: int

    def __call__(self, item: object) -> bytes:
        return os.urandom(self.size)


@dataclass(frozen=True)
class Pass:
    """items: of so many pairs each, and the bytes that come back for each."""

    name: str
    pairs_an_item: int
    answer: Answers


PASSES = (
    Pass("ranges", 1, Answers(1200)),
    Pass("light", 64, Answers(64 * 350)),
    Pass("waters", 32, Answers(32 * 6000)),
    Pass("colors", 1, Answers(1200)),
)
"""Sizes as pickled in a run of the sample dive: a row, differences against three frames before, a
group's table and rows.
"""


def serve(address: str, number: int, folder: str, up: Event) -> None:
    """So many workers in this process, until it is killed."""
    import dask
    from distributed import Worker

    async def work() -> None:
        workers = [
            Worker(address, nthreads=1, local_directory=folder, dashboard=False, memory_limit=0)
            for _ in range(number)
        ]
        for start in range(0, number, 20):
            await asyncio.gather(*workers[start : start + 20])
        up.set()
        await asyncio.gather(*(worker.finished() for worker in workers))

    logging.disable()  # each worker says what it does
    with dask.config.set({"distributed.admin.system-monitor.interval": "10s"}):
        asyncio.run(work())


class Peak:
    """The most memory of a process, looked at five times a second."""

    def __init__(self, process: int) -> None:
        self.bytes, self._process = 0, psutil.Process(process)
        Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while self._process.is_running():
            self.bytes = max(self.bytes, self._process.memory_info().rss)
            time.sleep(LOOK_S)


def pair(number: int) -> Pair:
    name = f"GX_{1_600_000_000 + number}_250000"
    return Pair(
        name,
        Path(f"/data/dive/left/{name}.png"),
        Path(f"/data/dive/right/{name}.png"),
        1.6e9,
        (number, 1_000_000),
    )


class Pairs:
    """Items of a pass: pairs, or lists of neighbors."""

    def __init__(self, pairs: int, an_item: int) -> None:
        self._number, self._an_item = pairs // an_item, an_item

    def __len__(self) -> int:
        return self._number

    def __iter__(self) -> Iterator[Pair | list[Pair]]:
        for number in range(self._number):
            several = [pair(number * self._an_item + k) for k in range(self._an_item)]
            yield several if self._an_item > 1 else several[0]


def measure_scheduler(pairs: int, workers: int) -> None:
    """All passes, and what the scheduler took."""
    address = f"tcp://127.0.0.1:{PORT}"
    with (
        TemporaryDirectory() as folder,
        subprocess.Popen(scheduler_words(PORT), stderr=subprocess.DEVNULL) as scheduler,
    ):
        context = multiprocessing.get_context("spawn")
        up = context.Event()
        served = context.Process(target=serve, args=(address, workers, folder, up), daemon=True)
        served.start()
        try:
            up.wait()
            peak, process = Peak(scheduler.pid), psutil.Process(scheduler.pid)
            print(
                f"{workers} workers are connected: scheduler {peak.bytes / 2**20:.0f} MiB",
                flush=True,
            )
            for one in PASSES:
                used_s, begun_s, number = sum(process.cpu_times()[:2]), time.monotonic(), 0
                batches.SETTINGS = batches.BatchSettings(
                    most=max(PAIRS_A_BATCH // one.pairs_an_item, 1)
                )
                with cluster(address) as compute:
                    for _ in compute.each(one.answer, Pairs(pairs, one.pairs_an_item)):
                        number += 1
                used_s = sum(process.cpu_times()[:2]) - used_s
                count = number // batches.SETTINGS.most
                took = (
                    f"{time.monotonic() - begun_s:.0f} s, {1000 * used_s / max(count, 1):.1f} "
                    "ms of the scheduler a batch"
                )
                print(
                    f"{one.name}: some {count} batches, {took}; at most {peak.bytes / 2**20:.0f} "
                    "MiB so far",
                    flush=True,
                )
        finally:
            served.kill()
            scheduler.terminate()
