"""Runs on a cluster of this machine: kills of workers while they work, and what a batch costs beside its work.

python benchmarks/fleet.py kills --kills 30   # same bytes as threads, after that many kills of random workers
python benchmarks/fleet.py batches --number 2000          # processor time of client and scheduler a batch, and their memory
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import tempfile
import threading
import time
from pathlib import Path

import psutil

from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.cluster import batches
from stereo_seecolor.compute.cluster.connect import cluster
from stereo_seecolor.progress import RunOptions, Silence

DIVE = Path(__file__).resolve().parents[1] / "data_samples" / "reef"
PRODUCTS = ("corrected", "range", "confidence", "mask", "clouds")


def workers() -> list[psutil.Process]:
    found = psutil.Process().children(recursive=True)
    return [process for process in found if process.is_running() and "spawn_main" in " ".join(process.cmdline())]


def contents(out: Path) -> dict[str, str]:
    files = [path for product in PRODUCTS for path in (out / product).glob("*")] + [out / "water.json"]
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


class Killer(threading.Thread):
    """Kills a random worker every so many seconds."""

    def __init__(self, kills: int, every_s: float) -> None:
        super().__init__(daemon=True)
        self._left, self._every_s, self._ended, self.killed = kills, every_s, threading.Event(), 0
        self._random = random.Random(0)

    def run(self) -> None:
        while self._left > self.killed and not self._ended.wait(self._every_s * self._random.uniform(0.5, 1.5)):
            with contextlib.suppress(psutil.NoSuchProcess, IndexError):
                os.kill(self._random.choice(workers()).pid, signal.SIGKILL)
                self.killed += 1

    def end(self) -> None:
        self._ended.set()
        self.join()


def kills(folder: Path, number: int, every_s: float) -> None:
    sides = (DIVE / "left", DIVE / "right", DIVE / "cam.yaml")
    run(*sides, folder / "threads", options=RunOptions(listener=Silence()))
    killed, rounds = 0, 0
    while killed < number:
        rounds += 1
        out = folder / f"cluster{rounds}"
        with cluster("local:4") as compute:
            killer = Killer(number - killed, every_s)
            killer.start()
            summary = run(*sides, out, options=RunOptions(cluster=compute, listener=Silence()))
            killer.end()
        killed += killer.killed
        same = contents(out) == contents(folder / "threads")
        print(f"round {rounds}: {killer.killed} kills, {summary.count('ok')} pairs, same bytes: {same}", flush=True)
    print(f"processes left: {len(workers())}")


def overhead(number: int) -> None:
    batches.SETTINGS = batches.BatchSettings(most=1)
    with cluster("local:2") as compute:
        list(compute.each(abs, range(20)))
        start_s, begun = time.process_time(), time.monotonic()
        list(compute.each(abs, range(number)))
        cost_ms = 1000 * (time.process_time() - start_s) / number
        memory = psutil.Process().memory_info().rss / 1e6
        print(f"{number} batches: {cost_ms:.1f} ms of client and scheduler each, {memory:.0f} MB, {time.monotonic() - begun:.0f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("kills", "batches"))
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--every-s", type=float, default=4.0)
    parser.add_argument("--number", type=int, default=2000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.what == "kills":
            kills(Path(folder), options.kills, options.every_s)
        else:
            overhead(options.number)


if __name__ == "__main__":
    main()
