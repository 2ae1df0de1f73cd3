"""The work on a cluster: the same bytes as on threads, whatever is lost on the way, and one line
for what is wrong.
"""

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from distributed.comm.core import CommClosedError
from distributed.utils import LoopRunner, sync

from stereo_seecolor.errors import ClusterError, OutputError
from stereo_seecolor.extras.fleet.cluster import connect, dask_compute, ticket, worker
from stereo_seecolor.extras.fleet.cluster.batch_jobs import BatchJobs
from stereo_seecolor.extras.fleet.cluster.batches import SETTINGS, Batches
from stereo_seecolor.extras.fleet.cluster.connect import cluster
from stereo_seecolor.extras.fleet.cluster.dask_compute import DaskCompute
from stereo_seecolor.extras.fleet.cluster.ticket import Probe, Ticket, admit


def test_batches_take_about_a_minute_and_leave_some_for_all_workers() -> None:
    items = list(range(10_000))
    batches = Batches(items)
    seen = [batches.next(4), batches.next(4)]
    assert [len(batch) for batch in seen] == [1, 1]
    batches.learn(2.0, 1)
    while batch := batches.next(4):
        seen.append(batch)
    assert [item for batch in seen for item in batch] == items
    assert len(seen[2]) == SETTINGS.target_s / 2
    assert len(seen[-1]) == 1
    quick = Batches(range(100))
    quick.next(4)
    quick.learn(1e-3, 1)
    assert len(quick.next(4)) == 99 // 4  # longer ones would leave a worker without any
    unknown = Batches(iter(items))
    unknown.next(4)
    unknown.learn(1e-3, 1)
    assert len(unknown.next(4)) == SETTINGS.most


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Ticket:
    """A ticket that this process may serve, without the limits of a worker."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ticket, "_one_core", lambda: None)
    monkeypatch.setattr(ticket, "log_below", lambda _: None)
    (tmp_path / "probe").write_text("a")
    return Ticket.mine((Probe(tmp_path / "probe", "a", (tmp_path,)),))


def test_a_worker_that_can_do_the_work_is_admitted(mine: Ticket) -> None:
    admit(mine)


def test_a_worker_with_other_versions_is_named_with_them(mine: Ticket) -> None:
    other = tuple((name, "0.1" if name == "numpy" else version) for name, version in mine.versions)
    with pytest.raises(
        ClusterError,
        match=r"worker on .*: has other versions \(numpy .* there, 0.1 here\): install the same",
    ):
        admit(replace(mine, versions=other))


def test_a_worker_that_does_not_see_the_folders_is_named_with_them(
    mine: Ticket, tmp_path: Path
) -> None:
    gone = tmp_path / "gone"
    (probe,) = mine.probes
    for changed in (replace(probe, file=gone / "probe"), replace(probe, inputs=(gone,))):
        with pytest.raises(
            ClusterError, match=f"worker on .*: does not see {gone} .*mount it there"
        ):
            admit(replace(mine, probes=(changed,)))
    with pytest.raises(ClusterError, match=r"does not see .*gone"):
        admit(replace(mine, folder=gone))
    with pytest.raises(ClusterError, match="is another folder there"):
        admit(replace(mine, probes=(replace(probe, content="b"),)))


@pytest.mark.parametrize("name", ["local", "local:0", "tcp://x", "nowhere:3", "slurm:"])
def test_what_is_no_cluster_is_refused(name: str) -> None:
    with pytest.raises(ClusterError, match="is not a cluster: give local:N"), cluster(name):
        pass


@pytest.mark.slow
def test_what_is_wrong_with_a_job_file_is_said(tmp_path: Path) -> None:
    file = tmp_path / "cluster.yaml"
    for text, message in (
        (None, "cannot be read"),
        ("a: [", "is not YAML"),
        ("jobs: 0", "jobs: .*give at least jobs, cores and memory"),
        ("{cores: 1, memory: 1GB}", "either jobs or adaptive is needed"),
        (
            "{jobs: 1, adaptive: {maximum: 2}, cores: 1, memory: 1GB}",
            "either jobs or adaptive is needed",
        ),
        (
            "{adaptive: {minimum: 3, maximum: 2}, cores: 1, memory: 1GB}",
            "adaptive: .*minimum is more than maximum",
        ),
    ):
        if text is not None:
            file.write_text(text)
        with pytest.raises(ClusterError, match=message), cluster(f"slurm:{file}"):
            pass


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stereo_seecolor.extras.fleet.cluster.connect.SCHEDULER_TIMEOUT_S", 0.2)
    with (
        pytest.raises(ClusterError, match=r"tcp://127\.0\.0\.1:1: no scheduler answers"),
        cluster("tcp://127.0.0.1:1"),
    ):
        pass


def test_a_scheduler_of_another_version_is_said() -> None:
    found = {
        "scheduler": {"packages": {"distributed": "1.0"}},
        "client": {"packages": {"distributed": "2.0"}},
    }
    with pytest.raises(
        ClusterError,
        match=r"tcp://a:1: the scheduler has another version \(distributed 1.0 there, 2.0 here\)",
    ):
        connect._check_scheduler(SimpleNamespace(get_versions=lambda: found), "tcp://a:1")


class LostScheduler:
    """A client of Dask whose scheduler goes: while it is asked for workers, or for a result."""

    def __init__(
        self, status: str, asked: Exception | None = None, result: Exception | None = None
    ) -> None:
        self.status, self._asked, self._result = status, asked, result

    def nthreads(self) -> dict[str, int]:
        if self._asked:
            raise self._asked
        return {"tcp://worker": 1}

    def submit(self, *_: object, **__: object) -> "LostScheduler":
        return self

    def result(self, timeout: float) -> object:
        assert self._result
        raise self._result

    def cancel(self, *_: object, **__: object) -> None:
        raise UnboundLocalError("result")


@pytest.mark.parametrize(
    "client",
    [
        LostScheduler("closed", asked=UnboundLocalError("result")),
        LostScheduler("connecting", asked=OSError("timed out")),
        LostScheduler(
            "connecting", asked=AttributeError("'NoneType' object has no attribute 'ncores'")
        ),
        LostScheduler("closed", result=UnboundLocalError("result")),
        LostScheduler("closed", result=CommClosedError("gone")),
    ],
)
def test_a_scheduler_that_goes_while_it_is_asked_is_said(client: LostScheduler) -> None:
    with pytest.raises(
        ClusterError, match=r"tcp://a:1: the scheduler has ended .*run the same command again"
    ):
        list(DaskCompute(client, "tcp://a:1", lambda: None).each(abs, [1]))


def test_a_defect_of_the_work_is_not_the_schedulers() -> None:
    client = LostScheduler("running", result=UnboundLocalError("of the work"))
    with pytest.raises(UnboundLocalError, match="of the work"):
        list(DaskCompute(client, "tcp://a:1", lambda: None).each(abs, [1]))


def test_dask_returns_what_it_never_had_where_its_question_is_cancelled() -> None:
    """Why an UnboundLocalError is taken for a lost scheduler: to be dropped when this test
    fails.
    """
    runner = LoopRunner()
    runner.start()
    try:
        with pytest.raises(UnboundLocalError):
            sync(runner.loop, raising, asyncio.CancelledError())
    finally:
        runner.stop()


async def raising(error: BaseException) -> None:
    raise error


@pytest.mark.slow
def test_a_program_of_another_version_on_a_worker_is_said(
    local: DaskCompute, monkeypatch: pytest.MonkeyPatch
) -> None:
    def newer(*_: object) -> None:
        """Not on the workers."""

    newer.__module__, newer.__qualname__ = worker.__name__, "newer"
    monkeypatch.setattr(worker, "newer", newer, raising=False)
    monkeypatch.setattr(dask_compute, "do_batch", newer)
    with pytest.raises(
        ClusterError, match=r"local:2: a worker has another version: install the same version there"
    ):
        list(local.each(square, range(2)))


@pytest.fixture
def slurm_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BatchJobs:
    """Job 12, of which squeue says what is in the file ``queue``."""
    (tmp_path / "squeue").write_text(
        f'#!/bin/sh\ncat {tmp_path}/queue || {{ echo "squeue: error: no controller" >&2; exit 1; '
        f"}}\n"
    )
    (tmp_path / "squeue").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    return BatchJobs(
        "slurm", SimpleNamespace(workers={0: SimpleNamespace(job_id="12")}), tmp_path / "logs"
    )


def test_the_state_of_a_job_that_waits_is_told(slurm_job: BatchJobs, tmp_path: Path) -> None:
    (tmp_path / "queue").write_text("12 PENDING (Resources)\n")
    assert slurm_job.text() == f"job 12 is PENDING (Resources); logs are in {tmp_path / 'logs'}"
    assert not slurm_job.ended()
    (tmp_path / "queue").unlink()
    assert slurm_job.text().startswith("the queue gives no reason (")
    assert not slurm_job.ended()
    assert replace(slurm_job, kind="pbs").text().startswith("look at the queue; logs are in")


def test_the_log_of_a_job_that_ended_is_told(slurm_job: BatchJobs, tmp_path: Path) -> None:
    (tmp_path / "queue").write_text("")
    assert slurm_job.ended() == f"job 12 has ended: it has no log in {tmp_path / 'logs'}"
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/dask-worker-12.err").write_text("a\nno module named dask\n\n")
    assert slurm_job.ended().endswith("dask-worker-12.err ends with 'no module named dask'")


def test_what_a_killed_client_left_of_its_workers_is_deleted_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connect.tempfile, "gettempdir", lambda: str(tmp_path))
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    kept = [
        tmp_path / f"{connect.SCRATCH}{os.getpid()}-a",
        tmp_path / "stereo-seecolor-elsewhere-1-a",
        tmp_path / "other",
    ]
    left, mine = (
        tmp_path / f"{connect.SCRATCH}{gone.pid}-a",
        tmp_path / f"{connect.SCRATCH}{gone.pid}-my-dives",
    )
    for folder in (*kept, left):
        (folder / "dask-scratch-space").mkdir(parents=True)
        (folder / connect.MARK).touch()
    mine.mkdir()
    connect.remove_abandoned()
    assert sorted(tmp_path.iterdir()) == sorted([*kept, mine])


@pytest.fixture(scope="module")
def local() -> Iterator[DaskCompute]:
    with cluster("local:2") as compute:
        yield compute


def square(number: int) -> int:
    return number * number


def fail(number: int) -> int:
    raise OutputError(f"/disk: full at {number}")


@pytest.mark.slow
def test_results_come_in_order_and_errors_as_they_are(local: DaskCompute) -> None:
    assert list(local.each(square, range(30))) == [square(number) for number in range(30)]
    with pytest.raises(OutputError, match=r"worker on .+: /disk: full at 0"):
        list(local.each(fail, range(3)))
    results = local.each(square, iter(range(10_000)))
    assert next(results) == 0
    results.close()


@dataclass(frozen=True)
class Large:
    """Work that takes more memory than a worker has, the first so many times. tries: a file with a
    line for each worker it met.
    """

    name: str
    tries: Path
    times: int


def take_memory(item: Large) -> str:
    with item.tries.open("a") as file:
        file.write(f"{os.getpid()}\n")
    if len(item.tries.read_text().splitlines()) <= item.times:
        taken = b"x" * LIMIT_BYTES
        time.sleep(60)
        return f"was not ended with {len(taken)} bytes"
    return item.name


LIMIT_BYTES = 900_000_000


@pytest.mark.slow
def test_a_local_worker_beyond_its_memory_is_ended_and_its_batch_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connect, "_memory_bytes", lambda: LIMIT_BYTES)
    monkeypatch.setattr(
        connect,
        "DASK_SETTINGS",
        {**connect.DASK_SETTINGS, "distributed.scheduler.allowed-failures": 1},
    )
    once, always = (Large(f"frame{times}", tmp_path / str(times), times) for times in (1, 9))
    with cluster("local:1") as compute:
        assert list(compute.each(take_memory, [once, replace(once, name="next")])) == [
            "frame1",
            "next",
        ]
        with pytest.raises(
            ClusterError,
            match="local:1: the batch of frame9 ended 2 workers, most likely because of too "
            "little memory",
        ):
            list(compute.each(take_memory, [always]))
        assert list(compute.each(square, range(3))) == [0, 1, 4]
    assert len(set(once.tries.read_text().split())) == 2
    assert len(always.tries.read_text().split()) == 2
