"""A cluster by its name on the command line: ``local:4``, ``tcp://host:8786``, ``slurm:cluster.yaml``."""

import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereo_seecolor.errors import ClusterError

if TYPE_CHECKING:
    from stereo_seecolor.compute.cluster.dask_compute import DaskCompute

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
LOST_S = 60
"""Seconds that a lost worker has to come back by itself, before another is started in its place."""
FAILURES_ALLOWED = 10
"""Workers that a batch may lose before it is given up: machines are taken away, but a batch that ends every worker ends the run."""


@contextmanager
def cluster(name: str) -> Iterator["DaskCompute"]:
    """A ``Compute`` on the cluster of that name, for as long as the block runs. Raises ClusterError."""
    opener = _opener(name)
    try:
        from distributed import Client
    except ImportError as error:
        raise ClusterError(f"--cluster {name}: needs Dask: pip install 'stereo-seecolor[cluster]'") from error
    import dask

    from stereo_seecolor.compute.cluster.dask_compute import DaskCompute

    settings = {"distributed.scheduler.allowed-failures": FAILURES_ALLOWED, "distributed.deploy.lost-worker-timeout": LOST_S}
    with dask.config.set(settings), opener() as (address, revive, timeout_s):
        try:
            client: Any = Client(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, TimeoutError, ValueError) as error:
            raise ClusterError(
                f"{name}: no scheduler answers ({error}): start one with dask scheduler, and workers with dask worker {name}"
            ) from error
        with client:
            _wait(client, name, timeout_s)
            yield DaskCompute(client, name, revive)


Opened = tuple[Any, Callable[[], object], float]
"""Scheduler's address or cluster; what starts workers in place of those that are lost; seconds to wait for the first."""


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
    from distributed import LocalCluster

    with (
        tempfile.TemporaryDirectory(prefix="stereo-seecolor-") as folder,
        LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # any free port: two runs on one machine must not meet
            worker_dashboard_address=None,
            local_directory=folder,
            silence_logs=50,
        ) as started,
    ):
        yield started, lambda: started.scale(workers), LOCAL_TIMEOUT_S


@contextmanager
def _running(address: str) -> Iterator[Opened]:
    yield address, lambda: None, LOCAL_TIMEOUT_S


@contextmanager
def _jobs(kind: str, file: Path) -> Iterator[Opened]:
    """Jobs of a batch system, each with a worker."""
    from stereo_seecolor.compute.cluster.job_file import JobFile

    jobs = JobFile.read(file)
    try:
        import dask_jobqueue
    except ImportError as error:
        raise ClusterError(f"{kind}:{file}: needs dask-jobqueue: pip install 'stereo-seecolor[cluster]'") from error
    try:
        started = getattr(dask_jobqueue, JOB_CLASSES[kind])(**jobs.arguments())
    except (TypeError, ValueError) as error:
        raise ClusterError(f"{file}: {' '.join(str(error).split())}") from error
    with started:
        started.scale(jobs=jobs.jobs)
        yield started, lambda: started.scale(jobs=jobs.jobs), jobs.wait_s


def _wait(client: Any, name: str, timeout_s: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout_s)
    except TimeoutError as error:
        raise ClusterError(
            f"{name}: no worker came within {timeout_s:.0f} s: start some (dask worker), or look at the queue and at the jobs' logs"
        ) from error
