"""A dive with its map on a cluster of which workers, clients and schedulers are killed, against the
same on threads.
"""

import contextlib
import hashlib
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from arguments import sides

PROGRAM = (sys.executable, "-m", "stereo_seecolor")
MAP = ("mapping.voxel_m=0.02", "mapping.tile_m=0.75", "mapping.mosaic_m=0.02", "mapping.dem_m=0.02")
TIMES = frozenset({"frames.csv", "run.json", "index.html"})
"""Files that hold times, and differ between any two runs; the page's data hold them as well."""
STARTED_S = 0.5
"""Seconds of processor time after which a worker works."""
GONE_S = 90.0
"""Seconds that the workers of a killed client have to end: they look for it every few seconds, on a
busy machine.
"""


@dataclass
class Harm:
    """What is still to be done, and what was. clients: seconds after which each is killed."""

    workers: int
    clients: list[float]
    schedulers: list[float]
    every_s: float
    done: dict[str, int] = field(default_factory=lambda: {"worker": 0, "client": 0, "scheduler": 0})
    orphans: int = 0
    chance: random.Random = field(default_factory=lambda: random.Random(0))

    @property
    def left(self) -> bool:
        return self.done["worker"] < self.workers or bool(self.clients)


def contents(out: Path) -> dict[str, str]:
    """Hashes of all that a run leaves, without the program's own folder."""
    files = [
        path
        for path in out.rglob("*")
        if path.is_file() and path.name not in TIMES and path.parts[len(out.parts)] != ".state"
    ]
    names = {
        path: str(path.relative_to(out)) for path in files if path.parts[len(out.parts)] != "page"
    }
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for path, name in names.items()}


def workers_of(process: psutil.Process) -> list[psutil.Process]:
    """Those that are past their start: a cluster whose workers die while it starts is one that does
    not start.
    """
    with contextlib.suppress(psutil.Error):
        found = [child for child in process.children(recursive=True) if child.ppid() != process.pid]
        return [child for child in found if child.cpu_times().user > STARTED_S]
    return []


def kill_workers(client: psutil.Process, harm: Harm, ended: threading.Event) -> None:
    while harm.done["worker"] < harm.workers and not ended.wait(
        harm.every_s * harm.chance.uniform(0.5, 1.5)
    ):
        with contextlib.suppress(psutil.Error, IndexError):
            os.kill(harm.chance.choice(workers_of(client)).pid, signal.SIGKILL)
            harm.done["worker"] += 1


def attempt(words: list[str], harm: Harm, after_s: float | None) -> int:
    """One run of the client, killed after so many seconds; its exit code. What it leaves running is
    counted.
    """
    client = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    process, ended = psutil.Process(client.pid), threading.Event()
    killer = threading.Thread(target=kill_workers, args=(process, harm, ended))
    killer.start()
    family: set[psutil.Process] = set()
    end_s = time.monotonic() + (after_s or 1e9)
    while client.poll() is None and time.monotonic() < end_s:
        with contextlib.suppress(psutil.Error):
            family |= set(process.children(recursive=True))
        time.sleep(0.5)
    if client.poll() is None:
        client.kill()
        harm.done["client"] += 1
    _, said = client.communicate()
    ended.set()
    killer.join()
    if client.returncode > 0:
        print(f"  client says: {said.strip().splitlines()[-1:]}", flush=True)
    harm.orphans += still_there(family)
    return client.returncode


def still_there(family: set[psutil.Process]) -> int:
    end_s = time.monotonic() + GONE_S
    while time.monotonic() < end_s and any(map(alive, family)):
        time.sleep(0.5)
    return sum(map(alive, family))


def alive(process: psutil.Process) -> bool:
    with contextlib.suppress(psutil.Error):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


def scheduler_words(port: int) -> list[str]:
    options = f"--host 127.0.0.1 --port {port} --no-dashboard --no-show"
    return [sys.executable, "-m", "distributed.cli.dask_scheduler", *options.split()]


@contextmanager
def scheduler(port: int, workers: int) -> Iterator[subprocess.Popen[bytes]]:
    """A scheduler and its workers as an administrator starts them."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    head = subprocess.Popen(scheduler_words(port), **quiet)  # type: ignore[call-overload]
    options = f"tcp://127.0.0.1:{port} --nthreads 1 --no-nanny --no-dashboard --death-timeout 60"
    words = [sys.executable, "-m", "distributed.cli.dask_worker", *options.split()]
    hands = [subprocess.Popen(words, **quiet) for _ in range(workers)]  # type: ignore[call-overload]
    try:
        yield head
    finally:
        for process in (*hands, head):
            process.kill()
            process.wait()


def on_own_scheduler(command: list[str], harm: Harm) -> None:
    """Runs on a scheduler that is killed, until one comes to its end."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    code = 1
    while code:
        with scheduler(port, 2) as head:
            after_s = harm.schedulers.pop() if harm.schedulers else None
            timer = threading.Timer(after_s or 1e6, head.kill)
            timer.start()
            code = attempt([*command, "--cluster", f"tcp://127.0.0.1:{port}"], harm, None)
            timer.cancel()
            harm.done["scheduler"] += head.poll() is not None


def kills(folder: Path, pairs: int, harm: Harm) -> None:
    dive = folder / "dive"
    if not dive.exists():
        options = f"--pairs {pairs} --size 320x256 --progress none".split()
        words = [*PROGRAM, "synthesize", *options, "--out", str(dive)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    given = [*sides(dive), "--fuse", "--progress", "none"]
    settings = [word for setting in MAP for word in ("--set", setting)]

    def command(out: Path) -> list[str]:
        return [*PROGRAM, "run", *given, *settings, "--out", str(out)]

    # kept where it was made before
    subprocess.run(command(folder / "threads"), check=True, stdout=subprocess.DEVNULL)
    expected = contents(folder / "threads")
    number = 0
    while harm.left:
        number += 1
        out, attempts, code = folder / f"cluster{number}", 0, 1
        while code:
            attempts += 1
            after_s = harm.clients.pop() if harm.clients else None
            code = attempt([*command(out), "--cluster", "local:4"], harm, after_s)
        judge(out, expected, f"dive {number} on local:4, {attempts} attempts", harm)
    out = folder / "scheduler"
    on_own_scheduler(command(out), harm)
    judge(out, expected, "dive on a scheduler of its own", harm)


def judge(out: Path, expected: dict[str, str], what: str, harm: Harm) -> None:
    found = contents(out)
    different = sorted(
        name for name in expected.keys() | found.keys() if expected.get(name) != found.get(name)
    )
    rows = (out / "frames.csv").read_text().count(",ok,")
    temporary = len(list(out.rglob(".writing-*")))
    print(
        f"{what}: killed so far {harm.done}, {rows} pairs ok, {len(found)} files, different: "
        f"{different[:5] or 'none'}, "
        f"temporary files left: {temporary}, processes left: {harm.orphans}",
        flush=True,
    )
