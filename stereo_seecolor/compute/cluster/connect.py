"""A cluster by its name on the command line: ``local:4``, ``tcp://host:8786``, ``slurm:cluster.yaml``."""

import gc
import glob
import logging
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereo_seecolor.compute.cluster.batch_jobs import BatchJobs
from stereo_seecolor.compute.cluster.dask_settings import DASK_SETTINGS
from stereo_seecolor.compute.cluster.local_workers import CAN_FORK, Orders, starter
from stereo_seecolor.errors import ClusterError

if TYPE_CHECKING:
    from stereo_seecolor.compute.cluster.dask_compute import DaskCompute
    from stereo_seecolor.compute.cluster.job_file import JobFile

log = logging.getLogger(__name__)

JOB_CLASSES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "lsf": "LSFCluster",
    "sge": "SGECluster",
    "htcondor": "HTCondorCluster",
}
"""Name on the command line -> class of dask-jobqueue."""
FORMS = f"local:N, tcp://HOST:PORT, or {', '.join(JOB_CLASSES)} with a file, such as slurm:cluster.yaml"
SCHEDULER_TIMEOUT_S, LOCAL_TIMEOUT_S = 20, 120
"""A scheduler of a cluster answers within a second; a worker process of a busy machine needs up to a minute to import all."""
LOOK_S = 10.0
"""Seconds between two looks at the queue while no worker has come: batch systems are not to be asked every second."""
ADAPT_S, IDLE_LOOKS = "10s", 6
"""How often it is looked whether more or fewer jobs are wanted, and for how many looks a job has nothing to do before it ends."""
SCRATCH = f"stereo-seecolor-{platform.node()}-"
"""How the folder of local workers begins, in the one for temporary files; the client's process follows."""
MEMORY_SHARE = 0.95
"""Of the machine's memory, divided by the workers of this machine: what one may take."""


@contextmanager
def cluster(name: str, notice: Callable[[str], None] = log.warning) -> Iterator["DaskCompute"]:
    """A ``Compute`` on the cluster of that name, for as long as the block runs. notice: called with what is waited for.

    Raises ClusterError.
    """
    opener = _opener(name)
    try:
        from distributed import Client
    except ImportError as error:
        raise ClusterError(f"--cluster {name}: needs Dask: pip install 'stereo-seecolor[cluster]'") from error
    import dask

    from stereo_seecolor.compute.cluster.dask_compute import DaskCompute

    with dask.config.set(DASK_SETTINGS), _hushed("distributed.client"), opener() as opened:  # what it logs is raised, too
        try:
            client: Any = Client(  # type: ignore[no-untyped-call]
                opened.where,
                timeout=SCHEDULER_TIMEOUT_S,
                set_as_default=False,
                direct_to_workers=opened.where != name,  # a scheduler of this process would send on what it got from the same place
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise ClusterError(
                f"{name}: no scheduler answers ({error}): start one with dask scheduler, and workers with dask worker {name}"
            ) from error
        with client:
            _check_scheduler(client, name)
            _wait(client, opened, name, notice)
            yield DaskCompute(client, name, opened.revive, notice)


@dataclass(frozen=True, eq=False)
class Opened:
    """A cluster that was begun. where: its scheduler's address, or Dask's object. revive: starts workers in place of those lost.

    wait_s: for the first worker. jobs: those that workers run in, where they do.
    """

    where: Any
    wait_s: float = LOCAL_TIMEOUT_S
    revive: Callable[[], object] = lambda: None
    jobs: BatchJobs | None = None


def _opener(name: str) -> Callable[[], Any]:
    kind, _, rest = name.partition(":")
    if kind == "local" and re.fullmatch(r"[1-9]\d*", rest):
        return lambda: _local(int(rest))
    if kind in ("tcp", "tls", "ucx") and re.fullmatch(r"//[^/]+:\d+", rest):
        return lambda: _running(name)
    if kind in JOB_CLASSES and rest:
        return lambda: _jobs(kind, Path(rest))
    raise ClusterError(f"--cluster {name}: is no cluster: give {FORMS}")


@contextmanager
def _local(workers: int) -> Iterator[Opened]:
    """Processes of this machine; they end with this one, however it ends."""
    remove_abandoned()
    with tempfile.TemporaryDirectory(prefix=f"{SCRATCH}{os.getpid()}-") as scratch, ExitStack() as ends:
        if not CAN_FORK:
            started = ends.enter_context(_scheduler(workers, scratch))
            yield Opened(started, revive=lambda: started.scale(workers))
            return
        start = ends.enter_context(starter())  # before the scheduler, whose threads it must not copy
        started = _scheduler(0, scratch)
        ends.callback(started.close)
        start(Orders(started.scheduler_address, workers, int(MEMORY_SHARE * _memory_bytes() / workers), scratch))
        yield Opened(started)


def remove_abandoned() -> None:
    """Delete the workers' folders of clients of this machine that were killed together with what would have deleted them."""
    import psutil  # comes with Dask

    for folder in Path(tempfile.gettempdir()).glob(f"{glob.escape(SCRATCH)}*"):
        client = folder.name.removeprefix(SCRATCH).split("-")[0]
        if client.isdecimal() and not psutil.pid_exists(int(client)):
            shutil.rmtree(folder, ignore_errors=True)  # of another user it stays


def _scheduler(workers: int, scratch: str) -> Any:
    """A scheduler in this process, with so many workers of Dask's own."""
    from distributed import LocalCluster

    return LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",  # any free port: two runs on one machine must not meet
        worker_dashboard_address=None,
        local_directory=scratch,
        silence_logs=50,
    )


def _memory_bytes() -> int:
    """Of this machine, or of what this process may have of it."""
    from distributed.system import MEMORY_LIMIT

    return int(MEMORY_LIMIT)


@contextmanager
def _running(address: str) -> Iterator[Opened]:
    yield Opened(address)


@contextmanager
def _jobs(kind: str, file: Path) -> Iterator[Opened]:
    """Jobs of a batch system, each with a worker."""
    from stereo_seecolor.compute.cluster.job_file import JobFile

    content = JobFile.read(file)
    try:
        import dask_jobqueue
    except ImportError as error:
        raise ClusterError(f"{kind}:{file}: needs dask-jobqueue: pip install 'stereo-seecolor[cluster]'") from error
    try:
        started = getattr(dask_jobqueue, JOB_CLASSES[kind])(**content.arguments())
    except (TypeError, ValueError) as error:
        raise ClusterError(f"{file}: {' '.join(str(error).split())}") from error
    with started:
        with _hushed("tornado.application", "asyncio"):  # who tell of a refused job at length, before it is said in one line
            _submit(started, content, f"{kind}:{file}")
        revive = (lambda: None) if content.adaptive else lambda: started.scale(jobs=content.jobs)
        yield Opened(started, content.wait_s, revive, BatchJobs(kind, started, Path(content.log_directory)))


@contextmanager
def _hushed(*loggers: str) -> Iterator[None]:
    """Without the messages of these loggers, also those of tasks that nobody asks for any more."""
    levels = {name: logging.getLogger(name).level for name in loggers}
    for name in loggers:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _submit(started: Any, content: "JobFile", name: str) -> None:
    """The first jobs, and more as there is work where the file says so. Raises ClusterError where they are refused."""
    from distributed.core import Status

    async def submitted() -> None:
        await started
        refused = [job for job in started.workers.values() if job.status is Status.created]
        for job in refused:
            job.status = Status.closed  # or Dask stumbles over it at the end
        for job in refused:
            await job.start()  # again, to hear why it was refused

    adaptive = content.adaptive
    started.scale(jobs=adaptive.minimum if adaptive else content.jobs)
    try:
        started.sync(submitted)
    except (RuntimeError, OSError) as error:
        why = next((line.strip() for line in str(error).splitlines()[::-1] if "error" in line.lower()), str(error))
        raise ClusterError(f"{name}: a job was refused: {why}") from error
    if adaptive:
        started.adapt(minimum_jobs=adaptive.minimum, maximum_jobs=adaptive.maximum, interval=ADAPT_S, wait_count=IDLE_LOOKS)


def _check_scheduler(client: Any, name: str) -> None:
    """The scheduler must be of the client's version of Dask, or it ends with an error that says nothing."""
    there, here = (client.get_versions()[side]["packages"]["distributed"] for side in ("scheduler", "client"))
    if there != here:
        raise ClusterError(f"{name}: the scheduler has another version (distributed {there} there, {here} here): install the same")


def _wait(client: Any, opened: Opened, name: str, notice: Callable[[str], None]) -> None:
    """For the first worker. Raises ClusterError with what the batch system says of the jobs, as soon as none of them can come."""
    jobs, end_s, noticed = opened.jobs, time.monotonic() + opened.wait_s, False
    while True:
        try:
            client.wait_for_workers(1, timeout=max(min(LOOK_S, end_s - time.monotonic()), 0.1))
            return
        except TimeoutError as error:
            if jobs and (ended := jobs.ended()):
                raise ClusterError(f"{name}: no worker came: {ended}") from error
            over = time.monotonic() >= end_s
            if noticed and not over:
                continue
            why = jobs.text() if jobs else f"start some (dask worker {name})"
            if over:
                raise ClusterError(f"{name}: no worker came within {opened.wait_s:.0f} s: {why}") from error
            notice(f"{name}: no worker yet; waiting for one for {opened.wait_s:.0f} s: {why}")
            noticed = True
