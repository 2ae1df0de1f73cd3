"""A run whose workers are jobs of a real SLURM on this machine: the same bytes as on threads."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import contents

from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.cluster.connect import cluster
from stereo_seecolor.progress import RunOptions

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT.parent / "shared" / "tools" / "slurm-one-node"


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file that names a SLURM of this machine alone to --cluster."""
    if os.geteuid() != 0 or not SCRIPT.exists() or not all(map(shutil.which, ("slurmctld", "slurmd", "munged"))):
        pytest.skip("needs root, Debian's slurm-wlm and munge, and the script slurm-one-node beside the checkout")
    folder = tmp_path / "slurm"
    subprocess.run([SCRIPT, "start", folder], check=True, capture_output=True)
    monkeypatch.setenv("SLURM_CONF", str(folder / "slurm.conf"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    try:
        file = tmp_path / "cluster.yaml"
        file.write_text(f"{{jobs: 1, cores: 1, memory: 2GB, interface: lo, wait_s: 180, log_directory: {tmp_path / 'logs'}}}")
        yield file
    finally:
        subprocess.run([SCRIPT, "stop", folder], check=False)


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
