"""The ``Compute`` of a Dask cluster: batches of items go out, results come back in the items' order."""

import logging
import secrets
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import cloudpickle
from distributed.client import FutureCancelledError
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker

from stereo_seecolor.compute.cluster.batches import Batches
from stereo_seecolor.compute.cluster.ticket import Probe, Ticket
from stereo_seecolor.compute.cluster.worker import Done, do_batch
from stereo_seecolor.compute.interface import Item, Result, Sum
from stereo_seecolor.errors import ClusterError

AHEAD = 2
"""Batches a worker that are under way or wait: it has the next one when it ends one."""
REVIVE_S = 15.0
"""Seconds between two looks at whether all workers are there: a worker of a busy machine needs some to start."""

Future = Any
"""Of Dask, whose classes carry no types."""

log = logging.getLogger(__name__)


class DaskCompute:
    """Work on the workers of a cluster. name: as on the command line. revive: starts workers in place of those that are lost."""

    def __init__(self, client: Any, name: str, revive: Callable[[], object]) -> None:
        self._client, self._name, self._revive = client, name, revive
        self._revived_s = time.monotonic()
        self._probes: tuple[Probe, ...] = ()

    @contextmanager
    def sharing(self, folder: Path, inputs: Sequence[Path]) -> Iterator[None]:
        """Every worker makes sure that it sees this ``folder`` and the ``inputs`` before it begins."""
        file = (folder / f".writing-probe-{secrets.token_hex(4)}").absolute()
        seen = tuple(path.absolute() for path in inputs if path.exists())
        probe = Probe(file, secrets.token_hex(16), seen)
        probe.file.write_text(probe.content)
        self._probes += (probe,)
        try:
            yield
        finally:
            self._probes = tuple(other for other in self._probes if other is not probe)
            probe.file.unlink(missing_ok=True)

    def each(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every item, in the items' order. A lost worker's batch is done again by another."""
        send = self._sender(cloudpickle.dumps(work))
        waiting: deque[tuple[Future, int]] = deque()
        batches, done = Batches(items), False
        with ExitStack() as ends:
            ends.callback(lambda: self._cancel(future for future, _ in waiting))
            while waiting or not done:
                workers = self._workers()
                while not done and len(waiting) < AHEAD * workers + 1:
                    batch = batches.next(workers)
                    done = not batch
                    if batch:
                        waiting.append((send(batch), len(batch)))
                if waiting:
                    future, number = waiting[0]
                    result = self._result(future)
                    waiting.popleft()
                    batches.learn(result.seconds, number)
                    yield from result.results

    def total(self, work: Callable[[Item], Sum], items: Iterable[Item]) -> Sum:
        """The sum of ``work`` of every item, added from the first to the last. Raises ValueError if there is no item."""
        results = self.each(work, items)
        try:
            first = next(results)
        except StopIteration:
            raise ValueError("nothing to add up") from None
        return reduce(add, results, first)

    def tiles(self, work: Callable[[Item], Result], tiles: Iterable[Item]) -> Iterator[Result]:
        """``work`` of every tile, one after the other, here: tiles are fused where the map is put together."""
        return map(work, tiles)

    def _sender(self, work: bytes) -> Callable[[list[Any]], Future]:
        ticket = Ticket.mine(self._probes)
        return lambda batch: self._client.submit(do_batch, ticket, work, batch, pure=False, key=f"batch-{uuid.uuid4()}")

    def _workers(self) -> int:
        """Batches that can be done at once now; 1 where no worker has come yet."""
        self._look_after_workers()
        try:
            return max(int(sum(self._client.nthreads().values())), 1)
        except (OSError, CommClosedError) as error:
            raise self._gone(error) from error

    def _result(self, future: Future) -> Done:
        while True:
            try:
                result: Done = future.result(timeout=REVIVE_S)
                return result
            except KilledWorker as error:
                raise ClusterError(
                    f"{self._name}: a batch ended {error.allowed_failures + 1} workers, most likely for want of memory: give "
                    "workers more memory, or fewer threads (docs/fleets.md); what is done is kept"
                ) from error
            except (FutureCancelledError, CommClosedError) as error:
                raise self._gone(error) from error
            except ImportError as error:
                raise ClusterError(f"{self._name}: a worker lacks {error.name}: install stereo-seecolor there, too") from error
            except TimeoutError:
                self._look_after_workers()

    def _look_after_workers(self) -> None:
        now_s = time.monotonic()
        if now_s - self._revived_s >= REVIVE_S:
            self._revived_s = now_s
            self._revive()
            if not self._client.nthreads():
                log.warning("%s: no worker is connected: waiting for one", self._name)

    def _gone(self, error: Exception) -> ClusterError:
        return ClusterError(f"{self._name}: the scheduler is gone ({error}): run the same line again, what is done is kept")

    def _cancel(self, futures: Iterable[Future]) -> None:
        left = list(futures)
        if left:
            self._client.cancel(left, force=True)
