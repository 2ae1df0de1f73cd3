"""Connects to a cluster by its name: ``local:4``, ``tcp://host:8786``, ``slurm:cluster.yaml``."""

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
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereo_seecolor.errors import ClusterError, library_for
from stereo_seecolor.extras.fleet.cluster.batch_jobs import BatchJobs
from stereo_seecolor.extras.fleet.cluster.dask_settings import DASK_SETTINGS
from stereo_seecolor.extras.fleet.cluster.local_workers import CAN_FORK, Orders, starter
from stereo_seecolor.extras.fleet.cluster.run_keys import (
    WITHOUT_PAGES,
    in_files,
    run_keys,
    workers_part,
)

if TYPE_CHECKING:
    from stereo_seecolor.extras.fleet.cluster.dask_compute import DaskCompute
    from stereo_seecolor.extras.fleet.cluster.job_file import JobFile

log = logging.getLogger(__name__)

JOB_CLASSES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "lsf": "LSFCluster",
    "sge": "SGECluster",
    "htcondor": "HTCondorCluster",
}
"""Name on the command line -> class of dask-jobqueue."""
FORMS = (
    f"local:N, tcp://HOST:PORT, or {', '.join(JOB_CLASSES)} with a file, such as slurm:cluster.yaml"
)
SCHEDULER_TIMEOUT_S, LOCAL_TIMEOUT_S = 20, 120
"""Seconds to wait for a scheduler, which answers within one; and for a worker process, which
imports modules for up to a minute.
"""
LOOK_S = 10.0
"""Seconds between two queries of the queue while no worker is connected: batch systems must not be
queried every second.
"""
ADAPT_S, IDLE_LOOKS = "10s", 6
"""Time between two decisions on the number of jobs, and the number of decisions for which a job is
idle before it ends.
"""
SCRATCH = f"stereo-seecolor-{platform.node()}-"
"""Begins the name of local workers' temporary folder; the client's process number follows."""
MARK = ".scratch-of-stereo-seecolor-workers"
"""A file in each folder made for workers: others with such a name are not deleted."""
MEMORY_FRACTION = 0.95
"""Fraction of the machine's memory that its workers together may take."""


@contextmanager
def cluster(name: str, notice: Callable[[str], None] = log.warning) -> Iterator["DaskCompute"]:
    """A ``Compute`` on the cluster of that name, while the block runs. notice: called with a line
    on what is waited for.

    Raises ClusterError for an unknown name, or where the cluster cannot be reached.
    """
    opener = _opener(name)
    with library_for(f"--cluster {name}", "cluster", ClusterError):
        from distributed import Client
    import dask

    from stereo_seecolor.extras.fleet.cluster.dask_compute import DaskCompute

    # what it logs is raised, too
    with dask.config.set(DASK_SETTINGS), _hushed("distributed.client"), opener() as opened:
        try:
            client: Any = Client(  # type: ignore[no-untyped-call]
                opened.where,
                timeout=SCHEDULER_TIMEOUT_S,
                set_as_default=False,
                direct_to_workers=opened.where
                # a scheduler of this process would send on what it got from the same place
                != name,
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise ClusterError(
                f"{name}: no scheduler answers ({error}): start one with dask scheduler, and "
                f"workers with dask worker {name}"
            ) from error
        with client:
            _check_scheduler(client, name)
            _wait(client, opened, name, notice)
            yield DaskCompute(client, name, opened.revive, notice)


@dataclass(frozen=True, eq=False)
class OpenedCluster:
    """A cluster that was started. where: its scheduler's address, or Dask's object. revive: starts
    workers in place of lost ones.

    wait_s: seconds to wait for the first worker. jobs: batch jobs that workers run in, None where
    they run in none.
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
        return lambda: nullcontext(OpenedCluster(name))
    if kind in JOB_CLASSES and rest:
        return lambda: _jobs(kind, Path(rest))
    raise ClusterError(f"--cluster {name}: is not a cluster: give {FORMS}")


@contextmanager
def _local(workers: int) -> Iterator[OpenedCluster]:
    """Worker processes on this machine; they end with this process, however it ends."""
    remove_abandoned()
    with (
        tempfile.TemporaryDirectory(prefix=f"{SCRATCH}{os.getpid()}-") as scratch,
        ExitStack() as ends,
    ):
        (Path(scratch) / MARK).touch()
        if not CAN_FORK:
            started = ends.enter_context(_scheduler(workers, scratch, run_keys(f"local:{workers}")))
            yield OpenedCluster(started, revive=lambda: started.scale(workers))
            return
        # before the scheduler, whose threads it must not copy
        start = ends.enter_context(starter())
        keys = run_keys(f"local:{workers}")
        started = _scheduler(0, scratch, keys)
        ends.callback(started.close)
        memory_bytes = int(MEMORY_FRACTION * _memory_bytes() / workers)
        start(Orders(started.scheduler_address, workers, memory_bytes, scratch, workers_part(keys)))
        yield OpenedCluster(started)


def remove_abandoned() -> None:
    """Delete the folders of workers whose clients on this machine were killed."""
    import psutil  # comes with Dask

    for folder in Path(tempfile.gettempdir()).glob(f"{glob.escape(SCRATCH)}*"):
        client = folder.name.removeprefix(SCRATCH).split("-")[0]
        if (
            (folder / MARK).is_file()
            and not folder.is_symlink()
            and client.isdecimal()
            and not psutil.pid_exists(int(client))
        ):
            shutil.rmtree(folder, ignore_errors=True)  # of another user it stays


def _scheduler(workers: int, scratch: str, keys: Any) -> Any:
    """A scheduler in this process, with ``workers`` workers that only key holders can use."""
    from distributed import LocalCluster

    return LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        security=keys,
        dashboard_address=WITHOUT_PAGES["dashboard_address"],  # or two runs on one machine meet
        scheduler_kwargs=WITHOUT_PAGES,
        worker_dashboard_address=None,
        local_directory=scratch,
        silence_logs=50,
    )


def _memory_bytes() -> int:
    """Memory of this machine, or the limit of this process, bytes."""
    from distributed.system import MEMORY_LIMIT

    return int(MEMORY_LIMIT)


@contextmanager
def _jobs(kind: str, file: Path) -> Iterator[OpenedCluster]:
    """Jobs of a batch system, each with a worker."""
    from stereo_seecolor.extras.fleet.cluster.job_file import JobFile

    content = JobFile.read(file)
    with library_for(f"--cluster {kind}:{file}", "cluster", ClusterError):
        import dask_jobqueue
    with _key_folder(Path(content.log_directory)) as folder, ExitStack() as ends:
        arguments = {
            **content.arguments(),
            "security": in_files(run_keys(f"{kind}:{file}"), Path(folder)),
        }
        arguments["scheduler_options"] = {**WITHOUT_PAGES, **arguments.get("scheduler_options", {})}
        try:
            started = getattr(dask_jobqueue, JOB_CLASSES[kind])(**arguments)
        except (TypeError, ValueError) as error:
            raise ClusterError(f"{file}: {' '.join(str(error).split())}") from error
        ends.enter_context(started)
        # who tell of a refused job at length, before it is said in one line
        with _hushed("tornado.application", "asyncio"):
            _submit(started, content, f"{kind}:{file}")
        revive = (lambda: None) if content.adaptive else lambda: started.scale(jobs=content.jobs)
        yield OpenedCluster(
            started, content.wait_s, revive, BatchJobs(kind, started, Path(content.log_directory))
        )


def _key_folder(logs: Path) -> "tempfile.TemporaryDirectory[str]":
    """A folder beside the jobs' logs, which the nodes see and this user alone can read: the run's
    keys lie in it while it lasts.
    """
    try:
        logs.mkdir(parents=True, exist_ok=True)
        return tempfile.TemporaryDirectory(prefix=".keys-", dir=logs.absolute())
    except OSError as error:
        raise ClusterError(
            f"log_directory: {logs}: cannot be written: {error.strerror or error}"
        ) from error


@contextmanager
def _hushed(*loggers: str) -> Iterator[None]:
    """Suppress the messages of these loggers while the block runs, with those of tasks that are
    only then garbage-collected.
    """
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
    """Submit the first jobs, and of adaptive files more with the work. Raises ClusterError."""
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
        why = next(
            (line.strip() for line in str(error).splitlines()[::-1] if "error" in line.lower()),
            str(error),
        )
        raise ClusterError(f"{name}: a job was refused: {why}") from error
    if adaptive:
        started.adapt(
            minimum_jobs=adaptive.minimum,
            maximum_jobs=adaptive.maximum,
            interval=ADAPT_S,
            wait_count=IDLE_LOOKS,
        )


def _check_scheduler(client: Any, name: str) -> None:
    """Raise ClusterError if the scheduler has another Dask, whose error would be unclear."""
    there, here = (
        client.get_versions()[side]["packages"]["distributed"] for side in ("scheduler", "client")
    )
    if there != here:
        raise ClusterError(
            f"{name}: the scheduler has another version (distributed {there} there, {here} "
            "here): install the same version"
        )


def _wait(client: Any, opened: OpenedCluster, name: str, notice: Callable[[str], None]) -> None:
    """For the first worker. Raises ClusterError with the batch system's words if none can come."""
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
                raise ClusterError(
                    f"{name}: no worker came within {opened.wait_s:.0f} s: {why}"
                ) from error
            notice(f"{name}: no worker yet; waiting for one for {opened.wait_s:.0f} s: {why}")
            noticed = True
