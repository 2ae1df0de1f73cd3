"""The ``Compute`` of a Dask cluster: batches go to workers, results come in items' order."""

import logging
import pickle
import secrets
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cloudpickle
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker

from stereo_seecolor.compute.interface import Item, Result, Usage
from stereo_seecolor.errors import ClusterError, OutputError
from stereo_seecolor.extras.fleet.cluster.batches import Batches, named
from stereo_seecolor.extras.fleet.cluster.ticket import Probe, Ticket
from stereo_seecolor.extras.fleet.cluster.worker import Done, Parcel, SharedFile, do_batch, do_tiles
from stereo_seecolor.files.atomic import TEMPORARY_PREFIX

AHEAD = 2
"""Batches for each worker that are under way or wait, so that the next is there when one ends."""
LOOK_S = 0.5
"""Seconds between two requests to the scheduler for the number of workers."""
REVIVE_S = 15.0
"""Seconds between checks that all workers are connected: a busy machine starts one in several."""

UNKNOWN_NAME = "Can't get attribute"
"""Beginning of pickle's message for a name that a module of another version lacks."""
LARGE_BYTES = 1 << 16
"""Bytes of pickled work above which it is written to a file that all workers read once, instead of
sent with every batch.
"""

LOST = (OSError, CommClosedError, FutureCancelledError, AttributeError, UnboundLocalError)
"""Exceptions of a client whose scheduler is gone: AttributeError where Dask asks the connection
that it has just dropped (None), the last where it cancels its own question, and then returns the
answer that it never had (``distributed.utils.sync``, which catches no CancelledError).
"""

Future = Any
"""A future of Dask, whose classes have no types."""
DoBatch = Callable[[Ticket, Parcel, bytes], Done]

log = logging.getLogger(__name__)


class DaskCompute:
    """Runs work on the workers of a cluster. name: as on the command line. revive: starts workers
    in place of lost ones.

    notice: called with a line when all workers are lost.
    """

    def __init__(
        self,
        client: Any,
        name: str,
        revive: Callable[[], object],
        notice: Callable[[str], None] = log.warning,
    ) -> None:
        self._client, self._name, self._revive, self._notice = client, name, revive, notice
        self._alone = False
        self._revived_s = time.monotonic()
        self._workers: dict[str, int] = {}
        self._looked_s = -LOOK_S
        self._probes: tuple[Probe, ...] = ()
        self._used: dict[str, tuple[float, int]] = {}

    @property
    def usage(self) -> Usage:
        """The resources of all workers, including lost ones, as of the last batch of each."""
        used = self._used.values()
        cores = sum(self._threads().values())
        return Usage(
            cores, sum(seconds for seconds, _ in used), max((peak for _, peak in used), default=0)
        )

    @property
    def parts(self) -> int:
        """One for each core of the workers that are connected now."""
        return max(sum(self._threads().values()), 1)

    @contextmanager
    def sharing(self, folder: Path, inputs: Sequence[Path]) -> Iterator[None]:
        """Let every worker check, before a batch, that it sees ``folder`` and ``inputs``."""
        file = (folder / f"{TEMPORARY_PREFIX}probe-{secrets.token_hex(4)}").absolute()
        seen = tuple(path.absolute() for path in inputs if path.exists())
        probe = Probe(file, secrets.token_hex(16), seen)
        with _written(probe.file):
            probe.file.write_bytes(probe.content.encode())
        self._probes += (probe,)
        try:
            yield
        finally:
            self._probes = tuple(other for other in self._probes if other is not probe)
            with suppress(OSError):
                probe.file.unlink(missing_ok=True)

    def each(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every item, in order. A lost worker's batch is done again by another."""
        return self._ordered(
            do_batch, work, Batches(items), lambda nthreads: sum(nthreads.values())
        )

    def tiles(self, work: Callable[[Item], Result], tiles: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every tile, in order: one at a time on each worker, with all its threads."""
        return self._ordered(do_tiles, work, Batches(tiles, most=1), len)

    def _ordered(
        self,
        do: DoBatch,
        work: Callable[[Item], Result],
        batches: Batches[Item],
        at_once: Callable[[dict[str, int]], int],
    ) -> Iterator[Result]:
        """``work`` of every item of ``batches``, in order.

        at_once: how many batches to do at once, from each worker's threads by address.
        """
        waiting: deque[tuple[Future, list[Item]]] = deque()
        done = False
        with ExitStack() as ends:
            send = self._sender(do, ends.enter_context(self._parcel(work)))
            ends.callback(lambda: self._cancel(future for future, _ in waiting))
            while waiting or not done:
                workers = max(at_once(self._threads()), 1)
                while not done and len(waiting) < AHEAD * workers + 1:
                    batch = batches.next(workers)
                    done = not batch
                    if batch:
                        waiting.append((send(batch), batch))
                if waiting:
                    future, batch = waiting[0]
                    result = self._result(future, batch)
                    waiting.popleft()
                    batches.learn(result.seconds, len(batch))
                    self._used[result.process] = result.used_core_seconds, result.peak_bytes
                    yield from result.results

    @contextmanager
    def _parcel(self, work: Callable[[Item], Result]) -> Iterator[Parcel]:
        """The pickled work as it is sent: if large, in a file of the shared folder, if any."""
        content = cloudpickle.dumps(work)
        if len(content) <= LARGE_BYTES or not self._probes:
            yield content
            return
        file = self._probes[-1].file.with_name(f"{TEMPORARY_PREFIX}work-{secrets.token_hex(8)}")
        try:
            with _written(file):
                shared = SharedFile.write(file, content)
            yield shared
        finally:
            with suppress(OSError):
                file.unlink(missing_ok=True)

    def _sender(self, do: DoBatch, work: Parcel) -> Callable[[list[Any]], Future]:
        ticket = Ticket.mine(self._probes)

        def send(batch: list[Any]) -> Future:
            call = pickle.dumps(_Call(do, (ticket, work, cloudpickle.dumps(batch))))
            return self._client.submit(pickle.loads, call, pure=False, key=f"batch-{uuid.uuid4()}")

        return send

    def _threads(self) -> dict[str, int]:
        """Threads of each worker, by address, as of the last request to the scheduler."""
        self._supervise_workers()
        if not self._workers or time.monotonic() - self._looked_s >= LOOK_S:
            self._workers, self._looked_s = self._connected(), time.monotonic()
        return self._workers

    def _result(self, future: Future, batch: Sequence[Any]) -> Done:
        while True:
            try:
                result: Done = future.result(timeout=REVIVE_S)
                return result
            except KilledWorker as error:
                raise ClusterError(
                    f"{self._name}: {named(batch)} ended {error.allowed_failures + 1} workers, "
                    "most likely because of too little memory: give workers more memory, or "
                    "fewer threads (docs/fleets.md); finished results are kept"
                ) from error
            except (FutureCancelledError, CommClosedError) as error:
                raise self._gone(error) from error
            except UnboundLocalError as error:
                if self._client.status == "running":  # of the work itself
                    raise
                raise self._gone(error) from error
            except ImportError as error:
                raise ClusterError(
                    f"{self._name}: a worker lacks {error.name}: install stereo-seecolor there, too"
                ) from error
            except AttributeError as error:
                if not str(error).startswith(UNKNOWN_NAME):
                    raise
                raise ClusterError(
                    f"{self._name}: a worker has another version: install the same version there "
                    f"({error})"
                ) from error
            except TimeoutError:
                self._supervise_workers()

    def _supervise_workers(self) -> None:
        now_s = time.monotonic()
        if now_s - self._revived_s >= REVIVE_S:
            self._revived_s = now_s
            self._revive()
            alone = not self._connected()
            if alone and not self._alone:
                self._notice(f"{self._name}: no worker is connected: waiting for one")
            self._alone = alone

    def _connected(self) -> dict[str, int]:
        """Threads of each connected worker, by address."""
        try:
            return dict(self._client.nthreads())
        except LOST as error:
            raise self._gone(error) from error

    def _gone(self, error: Exception) -> ClusterError:
        return ClusterError(
            f"{self._name}: the scheduler has ended ({error}): run the same command again, "
            "finished results are kept"
        )

    def _cancel(self, futures: Iterable[Future]) -> None:
        left = list(futures)
        if left:
            with suppress(*LOST):  # nobody works on them any more
                self._client.cancel(left, force=True)


@dataclass(frozen=True)
class _Call:
    """A call that is made when it is unpickled.

    A worker without this program, or with another version of it, then raises an error that the
    client receives. If it were sent a function that it cannot find, it would lose its connection.
    """

    do: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self.do, self.arguments


@contextmanager
def _written(file: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"{file}: cannot be written: {error.strerror or error}: free disk space and run again"
        ) from error
