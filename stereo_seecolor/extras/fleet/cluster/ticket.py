"""The ticket that a client sends with every batch, by which a worker checks before its first batch
that it can do the work.
"""

import os
import platform
import sys
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from stereo_seecolor.compute.process import tune_gc, tune_malloc
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.errors import ClusterError
from stereo_seecolor.extras.fleet.cluster.worker_log import log_below
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
    """Facts of the client. versions: see ``versions``. folder: its working folder."""

    versions: tuple[tuple[str, str], ...]
    folder: Path
    probes: tuple[Probe, ...] = ()

    @classmethod
    def mine(cls, probes: tuple[Probe, ...] = ()) -> "Ticket":
        """The ticket of this process."""
        return cls(versions(), Path.cwd(), probes)


@lru_cache(maxsize=8)
def admit(ticket: Ticket) -> None:
    """Check, once a process, that it can do this ticket's batches. Raises ClusterError."""
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
