"""Runs on a cluster whose workers or client are killed: the same bytes as on threads, and no
process left.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import psutil
import pytest
from conftest import contents

from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.interface import Item, Result
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.extras.fleet.cluster.connect import cluster


def workers() -> list[psutil.Process]:
    """Those that run now: a process may end, or be no more than an entry of the system's table,
    while it is looked at.
    """
    found = []
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if process.ppid() != os.getpid():
                found.append(process)
    return found


class Killer:
    """Kills a worker after some pairs."""

    def __init__(self, at: tuple[int, ...]) -> None:
        self._at, self._done = at, 0
        self.killed = 0

    def begin(self, stage: str, total: int) -> None:
        pass

    def advance(self, row: object) -> None:
        self._done += 1
        if self._done in self._at:
            wait_for(workers)  # one that was killed before may not have been replaced yet
            os.kill(workers()[-1].pid, signal.SIGKILL)
            self.killed += 1


@pytest.mark.slow
def test_workers_of_a_long_dive_are_killed(make_dive, tmp_path: Path, monkeypatch) -> None:
    """A long dive is added up in the same order wherever it is counted."""
    monkeypatch.setattr("stereo_seecolor.dive.passes.LONG_DIVE", 2)
    monkeypatch.setattr("stereo_seecolor.dive.pair_sequences.GROUP", 2)
    dive = make_dive(6)
    (dive.root / "R/0003.png").write_bytes(b"")
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    killer = Killer((2, 8))
    with cluster("local:2") as compute:
        summary = run(
            *sides, tmp_path / "cluster", options=RunOptions(cluster=compute, listener=killer)
        )
        again = run(*sides, tmp_path / "cluster", options=RunOptions(cluster=compute))
    assert killer.killed == 2
    logs = list((tmp_path / "cluster/.state/logs").iterdir())
    assert 2 <= len(logs) <= 4, (
        "one for each worker that was given work, those started anew among them"
    )
    assert all("worker begins" in log.read_text() for log in logs)
    assert (summary.count("ok"), summary.count("failed"), again.kept) == (5, 1, 5)
    run(*sides, tmp_path / "threads")
    assert contents(tmp_path / "cluster") == contents(tmp_path / "threads")
    assert not list((tmp_path / "cluster").rglob(".writing-probe*"))
    before = (tmp_path / "threads/water.json").read_bytes()
    again = run(*sides, tmp_path / "threads")
    assert (again.kept, (tmp_path / "threads/water.json").read_bytes()) == (5, before)


class NewWorkers(Threads):
    """Every item goes to a worker that begins with it, and makes sure that it sees the shared
    folder.
    """

    @contextlib.contextmanager
    def sharing(self, folder: Path, inputs: Sequence[Path]) -> Iterator[None]:
        self._probe = folder / ".writing-probe-1"
        self._probe.touch()
        yield
        self._probe.unlink(missing_ok=True)

    def each(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        for item in items:
            assert self._probe.exists()
            yield work(item)

    tiles = each


@pytest.mark.slow
def test_a_worker_that_begins_at_the_very_end_sees_the_shared_folder(
    make_dive, tmp_path: Path
) -> None:
    dive = make_dive(2)
    summary = run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        tmp_path / "out",
        options=RunOptions(cluster=NewWorkers(1)),
    )
    assert summary.count("ok") == 2


@pytest.mark.slow
def test_the_client_is_killed(make_dive, tmp_path: Path) -> None:
    dive, out = make_dive(5), tmp_path / "cluster"
    words = [
        sys.executable,
        "-m",
        "stereo_seecolor",
        *dive.command(out, "--cluster", "local:1", "--progress", "none"),
    ]
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    client = subprocess.Popen(words, env={**os.environ, "TMPDIR": str(temporary)})
    wait_for(lambda: client.poll() is not None or len(list((out / "range").glob("*.tiff"))) >= 2)
    assert client.poll() is None, "the client ended before it was killed"
    family = [
        client.pid,
        *(child.pid for child in psutil.Process(client.pid).children(recursive=True)),
    ]
    client.kill()
    client.wait()
    wait_for(lambda: not any(map(running, family)))
    assert not list(temporary.glob("stereo-seecolor*"))
    assert subprocess.run(words, stdout=subprocess.DEVNULL).returncode == 0
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "threads")
    assert contents(out) == contents(tmp_path / "threads")


def wait_for(true, timeout_s: float = 240.0) -> None:  # type: ignore[no-untyped-def]
    end_s = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def running(pid: int) -> bool:
    with contextlib.suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False
