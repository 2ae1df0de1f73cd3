"""Cuts items into batches of about a minute, small enough that all workers have some."""

from collections.abc import Iterable, Iterator, Sequence, Sized
from dataclasses import dataclass
from itertools import islice
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")


@dataclass(frozen=True)
class BatchSettings:
    """Settings of the size of a batch."""

    target_s: float = 60.0
    """Seconds of a batch: a scheduler spends 10 ms on it, and a lost worker costs no more."""
    least_s: float = 5.0
    """Seconds of work a batch at least, while all workers have some: of shorter ones the scheduler
    cannot send enough to 200.
    """
    rounds: int = 4
    """Least batches a worker, where there are enough items, so that none idles at the end."""
    tail_s: float = 0.5
    """Seconds of a pass's last batches: shorter ones save little, and each costs 10 ms."""
    most: int = 1000
    """Items a batch: their results are in memory together."""


SETTINGS = BatchSettings()


class Batches(Generic[Item]):
    """Items cut into batches as needed, by measured time; results do not depend on the cuts."""

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
    """A name for a batch in messages: of its first and last pair, if it holds any."""
    ends = [
        item[end] if isinstance(item, list) else item
        for item, end in ((batch[0], 0), (batch[-1], -1))
    ]
    names = list(dict.fromkeys(str(item.name) for item in ends if hasattr(item, "name")))
    return f"the batch of {' to '.join(names)}" if names else "a batch"
