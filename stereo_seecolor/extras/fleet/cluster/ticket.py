"""The ticket that a client sends with every batch, by which a worker checks before its first batch
that it can do the work.
"""

import faulthandler
import logging
import os
import platform
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from stereo_seecolor.compute.process import tune_gc, tune_malloc
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.errors import ClusterError
from stereo_seecolor.version import __version__

LIBRARIES = ("numpy", "scipy", "opencv-contrib-python-headless", "torch", "numba", "distributed")
"""Libraries whose version may change results, and the one that sends them."""


@cache
def versions() -> tuple[tuple[str, str], ...]:
    """Versions of Python, this program and the libraries in this process."""
    found = [("python", ".".join(map(str, sys.version_info[:2]))), ("stereo-seecolor", __version__)]
    for library in LIBRARIES:
        try:
            found.append((library, version(library)))
        except PackageNotFoundError:
            found.append((library, "missing"))
    return tuple(found)


@dataclass(frozen=True)
class Probe:
    """A file that the client wrote into the folder that workers write into, and its content.
    inputs: files that they read.
    """

    file: Path
    content: str
    inputs: tuple[Path, ...]


@dataclass(frozen=True)
class Ticket:
    """Facts of the client. versions: see ``versions``. folder: its working folder, for relative
    paths.
    """

    versions: tuple[tuple[str, str], ...]
    folder: Path
    probes: tuple[Probe, ...] = ()

    @classmethod
    def mine(cls, probes: tuple[Probe, ...] = ()) -> "Ticket":
        """The ticket of this process."""
        return cls(versions(), Path.cwd(), probes)


@lru_cache(maxsize=8)
def admit(ticket: Ticket) -> None:
    """Check, once in a process, that it can do batches with this ticket, and set it up. Raises
    ClusterError.
    """
    here = platform.node()
    differing = [
        f"{name} {mine} there, {theirs} here"
        for (name, mine), (_, theirs) in zip(versions(), ticket.versions, strict=True)
        if mine != theirs
    ]
    if differing:
        raise ClusterError(
            f"worker on {here}: has other versions ({'; '.join(differing)}): install the same "
            "versions on both machines"
        )
    try:
        os.chdir(ticket.folder)
    except OSError as error:
        raise ClusterError(_invisible(here, ticket.folder, error)) from error
    for probe in ticket.probes:
        _look(here, probe)
    if ticket.probes:
        log_below(ticket.probes[-1].file.parent)
    tune_malloc()
    tune_gc()
    _one_core()


def _look(here: str, probe: Probe) -> None:
    try:
        found = probe.file.read_text()
    except OSError as error:
        raise ClusterError(_invisible(here, probe.file.parent, error)) from error
    if found != probe.content:
        raise ClusterError(
            f"worker on {here}: {probe.file.parent} is another folder there: mount the same "
            "folder under the same path"
        )
    for path in probe.inputs:
        if not path.exists():
            raise ClusterError(_invisible(here, path, FileNotFoundError("no such file or folder")))


def _invisible(here: str, path: Path, error: OSError) -> str:
    return (
        f"worker on {here}: does not see {path} ({error.strerror or error}): mount it there "
        "under the same path"
    )


def _one_core() -> None:
    """Use one core for each batch: each thread of a worker does a batch of its own."""
    import cv2

    cv2.setNumThreads(1)
    limit_cores(1)
    torch: Any = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(1)
    os.environ.setdefault("OMP_NUM_THREADS", "1")


# Keys made for one run: scheduler, workers and client of a cluster that this program starts know
# each other by them.
#
# Without, whoever reaches a port of Dask's, as every user of the machine does, sends it pickled
# code, which it runs.

NO_PAGES: dict[str, Any] = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
WITHOUT_PAGES: dict[str, Any] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
"""Settings and arguments of a scheduler: Dask's web pages have no keys, and none is served."""


def run_keys(name: str) -> Any:
    """Dask's ``Security`` with a key and a certificate, in memory alone. Raises ClusterError where
    no library makes them.
    """
    from distributed.security import Security

    try:
        return Security.temporary()  # type: ignore[no-untyped-call]
    except ImportError as error:
        raise ClusterError(
            f"--cluster {name}: needs cryptography: pip install 'stereo-seecolor[cluster]'"
        ) from error


def workers_part(keys: Any) -> dict[str, str]:
    """What a worker needs of them, to be sent on a private way."""
    part = keys.get_tls_config_for_role("worker")
    return {name: part[name] for name in ("ca_file", "key", "cert")}


def of_worker(part: dict[str, str]) -> Any:
    """A worker's ``Security``."""
    return _security(("worker",), part)


def in_files(keys: Any, folder: Path) -> Any:
    """The same keys in files of ``folder``, which is this user's alone: jobs on other machines read
    them. Raises OSError.
    """
    part = {}
    for name, content in workers_part(keys).items():
        part[name] = str(folder / f"{name}.pem")
        with os.fdopen(
            os.open(part[name], os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w"
        ) as file:
            file.write(content)
    return _security(("client", "scheduler", "worker"), part)


def _security(roles: Sequence[str], part: dict[str, str]) -> Any:
    from distributed.security import Security

    own = {f"tls_{role}_{name}": part[name] for role in roles for name in ("key", "cert")}
    return Security(require_encryption=True, tls_ca_file=part["ca_file"], **own)  # type: ignore[no-untyped-call]


# The log of a worker: a file for each process, in the folder that it works on.

FOLDER = "logs"
FORM = "%(asctime)s %(levelname)s %(name)s: %(message)s"

log = logging.getLogger("stereo_seecolor")


def log_below(folder: Path) -> None:
    """Write this process's log to ``folder``/logs/HOST-PROCESS.log from now on, with the traceback
    of a crash.

    Writes none where the file cannot be written: the work itself will fail with the reason.
    """
    for handler in [handler for handler in log.handlers if isinstance(handler, WorkerLog)]:
        faulthandler.disable()
        log.removeHandler(handler)
        handler.close()
    with suppress(OSError):
        (folder / FOLDER).mkdir(exist_ok=True)
        handler = WorkerLog(
            folder / FOLDER / f"{platform.node()}-{os.getpid()}.log", encoding="utf-8"
        )
        handler.setFormatter(logging.Formatter(FORM))
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        faulthandler.enable(handler.stream.fileno() if handler.stream else 2)
        log.info("worker begins: process %d on %s", os.getpid(), platform.node())


class WorkerLog(logging.FileHandler):
    """The log file of a worker."""
