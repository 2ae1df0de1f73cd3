"""A recorded bag played at its own rate: to try settings, and to measure latency."""

import time
from bisect import bisect_right
from collections.abc import Callable, Sequence
from pathlib import Path

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.live.folder_watch import read_sides
from stereo_seecolor.inputs.pairing import Pair, Pairing
from stereo_seecolor.records import StereoFrame


class PlayedBag:
    """A source whose pairs arrive at the intervals at which they were taken.

    dropped: pairs skipped for newer ones. clock: seconds, for the arrival of pairs. Raises
    InputError for pairs without times.
    """

    waiting = "the time of the next pair in the bag"
    has_unpaired = False

    def __init__(
        self,
        pairing: Pairing,
        path: Path,
        config: InputConfig,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        times = [pair.timestamp_s for pair in pairing.pairs if pair.timestamp_s is not None]
        if len(times) < len(pairing.pairs):
            raise InputError(f"{path}: pairs without times cannot be played")
        self.dropped = 0
        self._pairs, self._clock, self._config = pairing.pairs, clock, config
        self._arrivals_s = [time_s - times[0] for time_s in times]
        self._began_s: float | None = None
        self._first: int | None = None
        self._next = 0

    @property
    def ended(self) -> bool:
        """True when all pairs have been taken or skipped."""
        return self._next >= len(self._pairs)

    def newest(self) -> Pair | None:
        """The newest pair that has arrived and was not taken; the first by the first call."""
        now_s = self._clock()
        self._began_s = now_s if self._began_s is None else self._began_s
        arrived = bisect_right(self._arrivals_s, now_s - self._began_s)
        return self._pairs[arrived - 1] if arrived > self._next else None

    def read(self, pair: Pair) -> StereoFrame:
        """Both images. Raises InputError."""
        return read_sides(pair, self._config)

    def take(self, pair: Pair) -> None:
        """Mark this pair and all before it as done."""
        number = self._pairs.index(pair)
        self._first = number if self._first is None else self._first
        self.dropped += number - self._next
        self._next = number + 1

    def still_there(self) -> Sequence[Pair]:
        """The pairs from the first that was taken to the last."""
        return self._pairs[self._first or 0 : self._next]

    def latency_s(self, pair: Pair) -> float:
        """Seconds since the pair arrived."""
        return self._clock() - (self._began_s or 0.0) - self._arrivals_s[self._pairs.index(pair)]
