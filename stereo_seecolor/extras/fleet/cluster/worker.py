"""Batches of items, and the functions that run on a worker and do them, one after the other."""

import hashlib
import logging
import os
import pickle
import platform
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

from stereo_seecolor.compute.process import peak_bytes
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.errors import ClusterError, DeviceError, OutputError
from stereo_seecolor.extras.fleet.cluster.batches import named
from stereo_seecolor.extras.fleet.cluster.ticket import Ticket, admit

WORKS_KEPT = 4
"""Unpickled works, with tables such as those of rectification, that a worker keeps: for a few dives
at once, some 50 MB each.
"""


@dataclass(frozen=True)
class SharedFile:
    """A file of the shared folder, writable by others; sha256: of the client's content."""

    path: Path
    sha256: bytes

    @classmethod
    def write(cls, path: Path, content: bytes) -> Self:
        """Write the content. Raises OSError."""
        path.write_bytes(content)
        return cls(path, hashlib.sha256(content).digest())

    def read_bytes(self) -> bytes:
        """The content. Raises ClusterError where it is not what the client wrote, OSError."""
        content = self.path.read_bytes()
        if hashlib.sha256(content).digest() != self.sha256:
            raise ClusterError(
                f"{self.path}: was changed or truncated; its code was not run: check who can "
                "write there"
            )
        return content


Parcel = bytes | SharedFile
"""Pickled work, or the file that holds it if it is too large to be sent with every batch."""

_whole_worker = threading.Lock()

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Done:
    """A batch's results in the items' order, pickled, and the seconds that it took. process: the
    worker, with its resources so far.

    Items and results are sent pickled: Dask would make arrays read-only or unaligned in memory.
    """

    pickled: bytes
    seconds: float
    process: str = ""
    used_core_seconds: float = 0.0
    peak_bytes: int = 0

    @property
    def results(self) -> list[Any]:
        """The result of each item."""
        results: list[Any] = pickle.loads(self.pickled)  # from a worker that serves this client
        return results


def do_batch(ticket: Ticket, work: Parcel, items: bytes) -> Done:
    """Do the pickled ``work`` on all pickled items. Raises ClusterError, and as ``work``."""
    admit(ticket)
    start, do = time.perf_counter(), _unpickled(work)
    try:
        batch = pickle.loads(items)
        results = [do(item) for item in batch]
    except (
        OutputError,
        DeviceError,
    ) as error:  # of this machine, most likely: a full disk, a library that is missing
        log.error("batch failed: %s", error)
        raise type(error)(f"worker on {platform.node()}: {error}") from error
    except Exception:
        log.exception("batch failed")
        raise
    seconds = time.perf_counter() - start
    log.info("%s (%s): %d done in %.1f s", named(batch), type(do).__name__, len(results), seconds)
    return Done(
        pickle.dumps(results),
        seconds,
        f"{platform.node()}:{os.getpid()}",
        time.process_time(),
        peak_bytes(),
    )


def do_tiles(ticket: Ticket, work: Parcel, items: bytes) -> Done:
    """``do_batch`` for work that fills the memory: one batch at a time, with all threads."""
    from distributed import get_worker

    with _whole_worker:
        admit(ticket)
        limit_cores(get_worker().state.nthreads)
        try:
            return do_batch(ticket, work, items)
        finally:
            limit_cores(1)  # as a batch has it


@lru_cache(maxsize=WORKS_KEPT)
def _unpickled(work: Parcel) -> Callable[[Any], Any]:
    content = work.read_bytes() if isinstance(work, SharedFile) else work
    # from the client that this worker serves
    function: Callable[[Any], Any] = pickle.loads(content)
    return function
