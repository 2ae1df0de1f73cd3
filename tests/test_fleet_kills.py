"""Runs on a cluster whose workers or client are killed, and on a real SLURM: the same bytes as on threads, and no process left."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from conftest import contents

from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.cluster.connect import cluster
from stereo_seecolor.progress import RunOptions

SLURM = Path(__file__).resolve().parents[2] / "shared" / "tools" / "slurm-one-node"


def workers() -> list[psutil.Process]:
    return [process for process in psutil.Process().children(recursive=True) if "spawn_main" in " ".join(process.cmdline())]


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
            with contextlib.suppress(psutil.NoSuchProcess):
                os.kill(workers()[-1].pid, signal.SIGKILL)
                self.killed += 1


@pytest.mark.slow
def test_workers_are_killed(make_dive, tmp_path: Path) -> None:
    dive = make_dive(6)
    (dive.root / "R/0003.png").write_bytes(b"")
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    killer = Killer((2, 8))
    with cluster("local:2") as compute:
        summary = run(*sides, tmp_path / "cluster", options=RunOptions(cluster=compute, listener=killer))
        again = run(*sides, tmp_path / "cluster", options=RunOptions(cluster=compute))
    assert killer.killed == 2
    assert (summary.count("ok"), summary.count("failed"), again.kept) == (5, 1, 5)
    run(*sides, tmp_path / "threads")
    assert contents(tmp_path / "cluster") == contents(tmp_path / "threads")
    assert not list((tmp_path / "cluster").rglob(".writing-probe*"))


@pytest.mark.slow
def test_the_client_is_killed(make_dive, tmp_path: Path) -> None:
    dive, out = make_dive(5), tmp_path / "cluster"
    words = [sys.executable, "-m", "stereo_seecolor", *dive.command(out, "--cluster", "local:1", "--progress", "none")]
    client = subprocess.Popen(words)
    wait_for(lambda: len(list((out / "range").glob("*.tiff"))) >= 2)
    family = [client.pid, *(child.pid for child in psutil.Process(client.pid).children(recursive=True))]
    client.kill()
    client.wait()
    wait_for(lambda: not any(map(running, family)))
    assert subprocess.run(words, stdout=subprocess.DEVNULL).returncode == 0
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "threads")
    assert contents(out) == contents(tmp_path / "threads")


def wait_for(true, timeout_s: float = 120.0) -> None:  # type: ignore[no-untyped-def]
    end_s = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def running(pid: int) -> bool:
    with contextlib.suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A SLURM of this machine alone; the file that names it to --cluster."""
    if os.geteuid() != 0 or not SLURM.exists() or not all(map(shutil.which, ("slurmctld", "slurmd", "munged"))):
        pytest.skip("needs root, Debian's slurm-wlm and munge, and the script slurm-one-node beside the checkout")
    folder = tmp_path / "slurm"
    subprocess.run([SLURM, "start", folder], check=True, capture_output=True)
    monkeypatch.setenv("SLURM_CONF", str(folder / "slurm.conf"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    try:
        file = tmp_path / "cluster.yaml"
        file.write_text(f"{{jobs: 1, cores: 2, memory: 2GB, interface: lo, wait_s: 120, log_directory: {tmp_path / 'logs'}}}")
        yield file
    finally:
        subprocess.run([SLURM, "stop", folder], check=False)


@pytest.mark.slurm
@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of dask-jobqueue, which warns of the dashboard's port among others
def test_a_real_slurm(make_dive, tmp_path: Path, slurm: Path) -> None:
    dive = make_dive(4)
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    with cluster(f"slurm:{slurm}") as compute:
        run(*sides, tmp_path / "cluster", options=RunOptions(cluster=compute))
    run(*sides, tmp_path / "threads")
    assert contents(tmp_path / "cluster") == contents(tmp_path / "threads")
    assert list((tmp_path / "logs").iterdir())
