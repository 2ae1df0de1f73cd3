"""What a client sends its workers with every batch, and what a worker checks before its first: that it can do the work."""

import os
import platform
import sys
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from stereo_seecolor.compute.allocator import keep_freed_memory
from stereo_seecolor.compute.cluster.worker_log import log_below
from stereo_seecolor.compute.garbage import collect_seldom
from stereo_seecolor.compute.kernel_cache import keep_on_this_machine
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.errors import ClusterError
from stereo_seecolor.version import __version__

LIBRARIES = ("numpy", "scipy", "opencv-contrib-python-headless", "torch", "numba", "distributed")
"""Those whose version shows in results, and the one that sends them."""


@cache
def versions() -> tuple[tuple[str, str], ...]:
    """Of Python, this program and the libraries, here."""
    found = [("python", ".".join(map(str, sys.version_info[:2]))), ("stereo-seecolor", __version__)]
    for library in LIBRARIES:
        try:
            found.append((library, version(library)))
        except PackageNotFoundError:
            found.append((library, "missing"))
    return tuple(found)


@dataclass(frozen=True)
class Probe:
    """A file that the client wrote where workers are to write, and what it holds. inputs: what they are to read."""

    file: Path
    content: str
    inputs: tuple[Path, ...]


@dataclass(frozen=True)
class Ticket:
    """The client's. folder: its working folder, which relative paths start from. host: its machine."""

    versions: tuple[tuple[str, str], ...]
    folder: Path
    host: str
    probes: tuple[Probe, ...] = ()

    @classmethod
    def mine(cls, probes: tuple[Probe, ...] = ()) -> "Ticket":
        """Of this process."""
        return cls(versions(), Path.cwd(), platform.node(), probes)


@lru_cache(maxsize=8)
def admit(ticket: Ticket) -> None:
    """Make sure, once a process, that batches with this ticket can be done here. Raises ClusterError, which names this machine."""
    here = platform.node()
    differing = [
        f"{name} {mine} there, {theirs} here"
        for (name, mine), (_, theirs) in zip(versions(), ticket.versions, strict=True)
        if mine != theirs
    ]
    if differing:
        raise ClusterError(f"worker on {here}: has other versions ({'; '.join(differing)}): install the same in both places")
    try:
        os.chdir(ticket.folder)
    except OSError as error:
        raise ClusterError(_invisible(here, ticket.folder, error)) from error
    for probe in ticket.probes:
        _look(here, probe)
    if ticket.probes:
        log_below(ticket.probes[-1].file.parent)
    if here != ticket.host:
        keep_on_this_machine()
    keep_freed_memory()
    collect_seldom()
    _one_core()


def _look(here: str, probe: Probe) -> None:
    try:
        found = probe.file.read_text()
    except OSError as error:
        raise ClusterError(_invisible(here, probe.file.parent, error)) from error
    if found != probe.content:
        raise ClusterError(f"worker on {here}: {probe.file.parent} is another folder there: mount the same one at the same place")
    for path in probe.inputs:
        if not path.exists():
            raise ClusterError(_invisible(here, path, FileNotFoundError("no such file or folder")))


def _invisible(here: str, path: Path, error: OSError) -> str:
    return f"worker on {here}: does not see {path} ({error.strerror or error}): mount it there at the same place"


def _one_core() -> None:
    """A batch has one core: a worker's threads are as many batches, and what works within one image must not crowd them."""
    import cv2

    cv2.setNumThreads(1)
    limit_cores(1)
    torch: Any = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(1)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
