"""The loop of a live dive: take the newest pair, correct it, count what happened; nothing that a pair does ends it.

What is made of a corrected pair (files, a recording, a page) is made behind, while the next pair is corrected.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from calibration import CalibrationError
from stereo_seecolor.compute.background import WorkBehind
from stereo_seecolor.errors import InputError, SeeColorError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.live.processing import LiveFrame
from stereo_seecolor.records import StereoFrame

POLL_S = 0.004
"""A source is polled at this interval: it adds 2 ms to the latency, and takes 1% of a processor."""

SETTLE_S = 2.0
"""A file that cannot be read may still be being written; after so long it counts as failed."""

LATENCIES = 1000
"""Latencies are kept of this many of the last pairs."""


class Source(Protocol):
    """Where pairs come from: the newest one wins."""

    dropped: int

    @property
    def waiting(self) -> str:
        """What does not come now, "" where all does."""

    def newest(self) -> Pair | None:
        """The newest pair that was not taken."""

    def read(self, pair: Pair) -> StereoFrame:
        """Its images as the cameras gave them. Raises InputError."""

    def take(self, pair: Pair) -> None:
        """This pair, and what came before it, is done."""

    @property
    def ended(self) -> bool:
        """No pair will come any more."""

    def latency_s(self, pair: Pair) -> float:
        """Seconds since the pair arrived."""


@dataclass
class LiveCounts:
    """What happened so far.

    images_s, products_s: of the last pairs, from arrival to the corrected image, and until all that is made of it is out (range,
    cloud, files, recording). reduced: what is done less of a pair to hold the budget, "" nothing.
    """

    done: int = 0
    failed: int = 0
    dropped: int = 0
    waiting: str = ""
    last_error: str = ""
    reduced: str = ""
    images_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))
    products_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))

    def facts(self) -> dict[str, Any]:
        """For a page or JSON; latencies as their median and 95th percentile, None before the first pair."""
        content = {name: value for name, value in vars(self).items() if not isinstance(value, deque)}
        for name, seconds in (("latency", self.images_s), ("products", self.products_s)):
            median_s, p95_s = (float(np.quantile(list(seconds), q)) if seconds else None for q in (0.5, 0.95))
            content |= {f"{name}_median_s": median_s, f"{name}_p95_s": p95_s}
        return content


@dataclass
class LiveSession:
    """source: pairs. process: corrects one.

    finish: makes what is wanted of each corrected pair, behind; an error of it ends the session.
    """

    source: Source
    process: Callable[[Pair], LiveFrame]
    finish: Callable[[LiveFrame], None]
    counts: LiveCounts = field(default_factory=LiveCounts)
    _behind: WorkBehind = field(default_factory=WorkBehind)
    _tried: tuple[str, float] = ("", 0.0)

    def run(self, ended: Callable[[LiveCounts], bool]) -> LiveCounts:
        """Until ``ended`` says so, the source ends, or Ctrl-C."""
        try:
            while not (ended(self.counts) or self.source.ended):
                if not self.step():
                    time.sleep(POLL_S)
        except KeyboardInterrupt:
            pass
        finally:
            self._behind.finish()
        return self.counts

    def step(self) -> bool:
        """Process the newest pair; False if there is none, or it is not written yet."""
        pair = self.source.newest()
        self.counts.waiting = self.source.waiting
        if pair is None:
            return False
        arrived_s = time.monotonic() - self.source.latency_s(pair)
        try:
            frame = self.process(pair)
        except InputError as error:
            if self._may_be_growing(pair):
                return False
            self._failed(error)
        except (SeeColorError, CalibrationError) as error:
            self._failed(error)
        else:
            self._corrected(frame, arrived_s)
        self.source.take(pair)
        self.counts.dropped = self.source.dropped
        return True

    def _corrected(self, frame: LiveFrame, arrived_s: float) -> None:
        self.counts.images_s.append(time.monotonic() - arrived_s)
        self.counts.done += 1
        self.counts.reduced = frame.reduced

        def finish() -> None:
            self.finish(frame)
            self.counts.products_s.append(time.monotonic() - arrived_s)

        self._behind.put(finish)

    def _failed(self, error: Exception) -> None:
        self.counts.failed += 1
        self.counts.last_error = str(error)

    def _may_be_growing(self, pair: Pair) -> bool:
        now_s = time.monotonic()
        if self._tried[0] != pair.name:
            self._tried = (pair.name, now_s)
        return now_s - self._tried[1] < SETTLE_S
