"""What runs on a worker: batches of items, one after the other."""

import pickle
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from stereo_seecolor.compute.cluster.ticket import Ticket, admit

WORKS_KEPT = 4
"""Passes whose tables, such as those of rectification, a worker keeps: a few dives at once, some 50 MB each."""


@dataclass(frozen=True)
class Done:
    """A batch's results in its items' order, and how long it took."""

    results: list[Any]
    seconds: float


def do_batch(ticket: Ticket, work: bytes, items: Sequence[Any]) -> Done:
    """The pickled ``work`` of every item. Raises ClusterError where this process cannot do it, and what ``work`` raises."""
    admit(ticket)
    start, do = time.perf_counter(), _unpickled(work)
    return Done([do(item) for item in items], time.perf_counter() - start)


@lru_cache(maxsize=WORKS_KEPT)
def _unpickled(work: bytes) -> Callable[[Any], Any]:
    function: Callable[[Any], Any] = pickle.loads(work)  # from the client that this worker serves
    return function
