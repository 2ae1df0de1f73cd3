"""Batches of items, and the functions that run on a worker and do them, one after the other."""

import hashlib
import logging
import os
import pickle
import platform
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from stereo_seecolor.compute.process import core_seconds, peak_bytes
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.errors import ClusterError, DeviceError, OutputError
from stereo_seecolor.extras.fleet.cluster.ticket import Ticket, admit

# Cuts items into batches: large enough to take about a minute, and small enough that all workers
# have some.

Item = TypeVar("Item")


@dataclass(frozen=True)
class BatchSettings:
    """Settings of the size of a batch."""

    target_s: float = 60.0
    """Seconds of work a batch: a scheduler spends some 10 ms on it, and a lost worker costs no more
    than this.
    """
    least_s: float = 5.0
    """Seconds of work a batch at least, while all workers have some: of shorter ones the scheduler
    cannot send enough to 200.
    """
    rounds: int = 4
    """Batches a worker at least, where there are enough items, so that none idles long at the
    end.
    """
    tail_s: float = 0.5
    """Seconds of work of the last batches of a pass: shorter ones save no noticeable time, and each
    costs 10 ms.
    """
    most: int = 1000
    """Items a batch: their results are in memory together."""


SETTINGS = BatchSettings()


class Batches(Generic[Item]):
    """Items cut into batches as they are needed. Results do not depend on the cuts, so that these
    follow the measured time.
    """

    def __init__(self, items: Iterable[Item], most: int | None = None) -> None:
        """most: items of a batch at most."""
        self._most = most or SETTINGS.most
        self._items: Iterator[Item] = iter(items)
        self._left = self._all = len(items) if isinstance(items, Sized) else None
        self._seconds, self._done = 0.0, 0

    def learn(self, seconds: float, items: int) -> None:
        """Note that ``items`` items took ``seconds``."""
        self._seconds += seconds
        self._done += items

    def next(self, workers: int) -> list[Item]:
        """The next batch, empty at the end; of one item until the time of an item is known."""
        batch = list(islice(self._items, self._size(workers)))
        if self._left is not None:
            self._left -= len(batch)
        return batch

    def _size(self, workers: int) -> int:
        if not self._done:
            return 1
        a_second, each = self._done / max(self._seconds, 1e-9), max(workers, 1)
        size = SETTINGS.target_s * a_second
        if self._left is not None and self._all is not None:
            least = min(SETTINGS.least_s * a_second, self._left / each)
            tail = min(SETTINGS.tail_s * a_second, self._all / (SETTINGS.rounds * each))
            size = min(size, max(self._left / (SETTINGS.rounds * each), least, tail))
        return max(1, min(int(size), self._most))


def named(batch: Sequence[Any]) -> str:
    """A name for a batch in messages: of its first and last pair, if it holds pairs or groups of
    pairs.
    """
    ends = [
        item[end] if isinstance(item, list) else item
        for item, end in ((batch[0], 0), (batch[-1], -1))
    ]
    names = list(dict.fromkeys(str(item.name) for item in ends if hasattr(item, "name")))
    return f"the batch of {' to '.join(names)}" if names else "a batch"


WORKS_KEPT = 4
"""Unpickled works, with tables such as those of rectification, that a worker keeps: for a few dives
at once, some 50 MB each.
"""


@dataclass(frozen=True)
class SharedFile:
    """A file of the shared folder, which others may be able to write; sha256: of the content that
    the client put there.
    """

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
    """Do the pickled ``work`` on all pickled items. Raises ClusterError where this process cannot,
    and as ``work``.
    """
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
        core_seconds(),
        peak_bytes(),
    )


def do_tiles(ticket: Ticket, work: Parcel, items: bytes) -> Done:
    """``do_batch`` for work that fills the memory: one batch at a time in this process, with all
    threads of the worker.
    """
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
