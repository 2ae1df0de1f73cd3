"""A run whose workers are jobs of a real SLURM on this machine: the same bytes as on threads."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import contents
from filelock import FileLock

from stereo_seecolor.commands.run import run
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import ClusterError
from stereo_seecolor.extras.fleet.cluster import connect
from stereo_seecolor.extras.fleet.cluster.connect import cluster

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = ROOT / "tests" / "support" / "slurm-one-node"


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The configuration of a SLURM of this machine alone, which runs."""
    if os.geteuid() != 0 or not all(map(shutil.which, ("slurmctld", "slurmd", "munged"))):
        pytest.skip("needs root, and Debian's slurm-wlm and munge")
    folder = tmp_path_factory.mktemp("slurm")
    alone = FileLock(tmp_path_factory.getbasetemp().parent / "slurm.lock")  # one SLURM a machine
    with alone:
        subprocess.run([SCRIPT, "start", folder], check=True, capture_output=True)
        try:
            yield folder / "slurm.conf"
        finally:
            subprocess.run([SCRIPT, "stop", folder], check=False)


@pytest.fixture
def slurm(controller: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that names it to --cluster."""
    monkeypatch.setenv("SLURM_CONF", str(controller))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    file = tmp_path / "cluster.yaml"
    file.write_text(
        f"{{jobs: 1, cores: 1, memory: 2GB, interface: lo, wait_s: 180, log_directory: "
        f"{tmp_path / 'logs'}}}"
    )
    return file


@pytest.mark.slurm
@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # libraries of the cluster warn of their own
def test_what_slurm_says_of_jobs_without_a_worker_is_told(
    tmp_path: Path, slurm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connect, "LOOK_S", 1.0)
    usual = (
        slurm.read_text()
        .removesuffix("}")
        .replace("wait_s: 180", "wait_s: 4")
        .replace("jobs: 1", "jobs: 2")
    )
    for more, message in (
        ("queue: nowhere", r"a job was refused: .*Invalid partition"),
        (
            "job_extra_directives: ['--begin=now+1hour']",
            r"no worker came within 4 s: job \d+ is PENDING \(BeginTime\); .*logs are in",
        ),
        (
            "wait_s: 60, job_script_prologue: ['echo no environment >&2; exit 3']",
            r"job \d+ has ended: .* 'no environment'",
        ),
    ):
        base = usual.replace(", wait_s: 4", "") if "wait_s" in more else usual
        slurm.write_text(f"{base}, {more}}}")
        with pytest.raises(ClusterError, match=message), cluster(f"slurm:{slurm}"):
            pass


@pytest.mark.slurm
@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_jobs_come_with_the_work(tmp_path: Path, slurm: Path) -> None:
    slurm.write_text(slurm.read_text().replace("jobs: 1", "adaptive: {maximum: 2}"))
    with cluster(f"slurm:{slurm}") as compute:
        assert list(compute.each(abs, range(-20, 0))) == list(range(20, 0, -1))


@pytest.mark.slurm
@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # libraries of the cluster warn of their own
def test_jobs_of_slurm_give_the_same_bytes(make_dive, tmp_path: Path, slurm: Path) -> None:
    dive = make_dive(4)
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    with cluster(f"slurm:{slurm}") as compute:
        run(*sides, tmp_path / "cluster", options=RunOptions(cluster=compute))
    run(*sides, tmp_path / "threads")
    assert contents(tmp_path / "cluster") == contents(tmp_path / "threads")
    assert list((tmp_path / "logs").iterdir())
