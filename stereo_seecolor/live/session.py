"""The loop of a live dive: take the newest pair, correct it, show it, count what happened; nothing that a pair does ends it."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np

from calibration import CalibrationError
from stereo_seecolor.errors import InputError, OutputError, SeeColorError
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.live.processing import LiveFrame

POLL_S = 0.02
"""A folder is looked at so often: a fifth of the time between pairs at 10 Hz."""

SETTLE_S = 2.0
"""A file that cannot be read may still be being written; after so long it counts as failed."""

LATENCIES = 1000
"""Of so many of the last pairs latencies are kept."""


class Source(Protocol):
    """Where pairs come from: the newest one wins."""

    dropped: int
    waiting: str

    def newest(self) -> Pair | None:
        """The newest pair that was not taken."""

    def take(self, pair: Pair) -> None:
        """This pair, and what came before it, is done."""

    @property
    def ended(self) -> bool:
        """No pair will come any more."""

    def latency_s(self, pair: Pair) -> float:
        """Seconds since the pair arrived."""


@dataclass
class LiveCounts:
    """What happened so far. latencies_s: of the last pairs, from the arrival of the later file to the corrected image."""

    done: int = 0
    failed: int = 0
    dropped: int = 0
    waiting: str = ""
    last_error: str = ""
    latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))

    def facts(self) -> dict[str, Any]:
        """For a page or JSON; latencies as their median and 95th percentile, None before the first pair."""
        median_s, p95_s = (float(np.quantile(self.latencies_s, q)) if self.latencies_s else None for q in (0.5, 0.95))
        content = asdict(self)
        del content["latencies_s"]
        return {**content, "latency_median_s": median_s, "latency_p95_s": p95_s}


@dataclass
class LiveSession:
    """source: pairs. process: corrects one. show: each corrected pair in turn; an OutputError of it ends the session."""

    source: Source
    process: Callable[[Pair], LiveFrame]
    show: Callable[[LiveFrame], None]
    counts: LiveCounts = field(default_factory=LiveCounts)
    _tried: tuple[str, float] = ("", 0.0)

    def run(self, ended: Callable[[LiveCounts], bool]) -> LiveCounts:
        """Until ``ended`` says so, the source ends, or Ctrl-C."""
        try:
            while not (ended(self.counts) or self.source.ended):
                if not self.step():
                    time.sleep(POLL_S)
        except KeyboardInterrupt:
            pass
        return self.counts

    def step(self) -> bool:
        """Process the newest pair; False if there is none, or it is not written yet."""
        pair = self.source.newest()
        self.counts.waiting = self.source.waiting
        if pair is None:
            return False
        try:
            frame = self.process(pair)
            self.counts.latencies_s.append(self.source.latency_s(pair))
            self.counts.done += 1
            self.show(frame)
        except OutputError:
            raise  # a full disk concerns every pair
        except InputError as error:
            if self._may_be_growing(pair):
                return False
            self._failed(error)
        except (SeeColorError, CalibrationError) as error:
            self._failed(error)
        self.source.take(pair)
        self.counts.dropped = self.source.dropped
        return True

    def _failed(self, error: Exception) -> None:
        self.counts.failed += 1
        self.counts.last_error = str(error)

    def _may_be_growing(self, pair: Pair) -> bool:
        now_s = time.monotonic()
        if self._tried[0] != pair.name:
            self._tried = (pair.name, now_s)
        return now_s - self._tried[1] < SETTLE_S
