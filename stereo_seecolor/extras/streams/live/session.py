"""The loop of a live session: take the newest pair, correct it, count the outcome. An error of a
pair does not end it.

Outputs of a corrected pair (files, a recording, a page) are made by another thread, while the next
pair is corrected.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from calibration import CalibrationError
from calibration.errors import counted
from stereo_seecolor.compute.background import WorkBehind
from stereo_seecolor.errors import InputError, SeeColorError
from stereo_seecolor.extras.streams.live.processing import LiveFrame
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import StereoFrame
from stereo_seecolor.run_folder.frame_table import kind_of

POLL_S = 0.004
"""Seconds between polls of the source: they add 2 ms of latency, and take 1 % of a core."""

SETTLE_S = 2.0
"""Seconds after which an unreadable file has failed: until then it may be being written."""

SILENT_S = 5.0
"""Seconds without a pair after which it is said what is waited for."""

MOST_KINDS = 100
"""Kinds of errors and warnings that are told: memory stays flat."""

LATENCIES = 1000
"""Number of the last pairs whose latencies are kept."""


class LiveSource(Protocol):
    """A source of pairs, of which the newest is processed. dropped: pairs skipped."""

    dropped: int

    @property
    def waiting(self) -> str:
        """What is missing for a pair: the sides from which nothing arrives now, or partners; "" if
        nothing is known to be missing.
        """

    @property
    def has_unpaired(self) -> bool:
        """True where images have come since the last pair, and none of them has a partner."""

    def newest(self) -> Pair | None:
        """The newest pair that was not taken; None for none."""

    def read(self, pair: Pair) -> StereoFrame:
        """The unrectified images of a pair. Raises InputError."""

    def take(self, pair: Pair) -> None:
        """Mark this pair and all before it as done."""

    def still_there(self) -> Sequence[Pair]:
        """The pairs from the first that was taken to the last, if they can be read again."""

    @property
    def ended(self) -> bool:
        """True when no more pairs will arrive."""

    def latency_s(self, pair: Pair) -> float:
        """Seconds since the pair arrived."""


class WaitNotice:
    """Tells what is waited for, once where no pair has come for some time."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self._told, self._last_s = tell, "", time.monotonic()

    def waiting(self, source: LiveSource, pair: Pair | None) -> str:
        """What is waited for; "" while pairs come. pair: the newest one, None for none."""
        now_s = time.monotonic()
        if pair is not None:
            self._last_s = now_s
        if pair is not None or now_s - self._last_s < SILENT_S:
            return ""
        waiting = source.waiting or "two images of one time: both sides send images of other times"
        if waiting != self._told:
            self._told = waiting
            self._tell(f"waiting for {waiting}")
        return waiting


def first_frames(
    source: LiveSource, tell: Callable[[str], None] = lambda _: None
) -> Iterator[StereoFrame]:
    """Pairs that can be read, each once; the last one stays.

    Waits for each, and tells so. Raises InputError where the source ends.
    """
    notice, read = WaitNotice(tell), ""
    while not source.ended:
        pair = source.newest()
        pair = pair if pair and pair.name != read else None
        notice.waiting(source, pair)
        if pair:
            with suppress(InputError):  # it may still be being written
                frame = source.read(pair)
                read = pair.name
                yield frame
        time.sleep(POLL_S)
    raise InputError("no readable pair arrived, and the calibration needs one")


@dataclass
class LiveCounts:
    """Counts and latencies of a live session.

    done, failed: pairs. biased: of the done ones, those whose rows are off. dropped: pairs skipped.
    waiting: what is waited for where no pair has come for some time, else "". images_s: seconds
    from the arrival of each of the last pairs to its corrected image; products_s: until all its
    outputs are written. written: pairs whose outputs are complete. has_unpaired: while something
    is waited for, images come that have no partner. reduced: a note where pairs are matched at
    reduced size, else "".
    """

    done: int = 0
    failed: int = 0
    biased: int = 0
    dropped: int = 0
    written: int = 0
    waiting: str = ""
    has_unpaired: bool = False
    last_error: str = ""
    reduced: str = ""
    images_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))
    products_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))

    def facts(self) -> dict[str, Any]:
        """The content for page or JSON; median and 95th percentile of latencies, None at first."""
        content = {
            name: value for name, value in vars(self).items() if not isinstance(value, deque)
        }
        for name, seconds in (("latency", self.images_s), ("products", self.products_s)):
            median_s, p95_s = (
                float(np.quantile(list(seconds), q)) if seconds else None for q in (0.5, 0.95)
            )
            content |= {f"{name}_median_s": median_s, f"{name}_p95_s": p95_s}
        return content


@dataclass
class LiveSession:
    """A live session. source: of pairs. process: corrects a pair.

    finish: makes the outputs of a corrected pair, in a thread; its error ends the session. tell:
    called with a line where no pair comes, and for the first pair with each kind of error or
    warning.
    """

    source: LiveSource
    process: Callable[[Pair], LiveFrame]
    finish: Callable[[LiveFrame], None]
    counts: LiveCounts = field(default_factory=LiveCounts)
    tell: Callable[[str], None] = lambda _: None
    _behind: WorkBehind = field(default_factory=WorkBehind)
    _tried: tuple[str, float] = ("", 0.0)
    _kinds: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._notice = WaitNotice(self.tell)

    def run(self, ended: Callable[[LiveCounts], bool]) -> LiveCounts:
        """Process pairs until ``ended`` is true, the source ends, or Ctrl-C; returns counts."""
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
        """Process the newest pair; False if there is none, or its files are still being written."""
        pair = self.source.newest()
        self.counts.waiting = self._notice.waiting(self.source, pair)
        self.counts.has_unpaired = bool(self.counts.waiting) and self.source.has_unpaired
        if pair is None:
            return False
        arrived_s = time.monotonic() - self.source.latency_s(pair)
        try:
            frame = self.process(pair)
        except InputError as error:
            if self._may_be_growing(pair):
                return False
            self._failed(pair, error)
        except (SeeColorError, CalibrationError) as error:
            self._failed(pair, error)
        else:
            self._corrected(frame, arrived_s)
        self.source.take(pair)
        is_first = self.counts.done + self.counts.failed == 1
        if is_first and self.source.dropped and pair.left.is_file():  # not of a camera
            self.tell(
                f"{counted(self.source.dropped, 'pair')} before {pair.name} skipped: live corrects "
                "the newest pair; run corrects all pairs of a folder"
            )
        self.counts.dropped = self.source.dropped
        return True

    def _corrected(self, frame: LiveFrame, arrived_s: float) -> None:
        self.counts.images_s.append(time.monotonic() - arrived_s)
        self.counts.done += 1
        self.counts.biased += frame.result.range_map.rows_are_off
        for warning in frame.result.warnings:
            self._tell_first(f"{frame.pair.name}: {warning}")
        self.counts.reduced = frame.reduced

        def finish() -> None:
            self.finish(frame)
            self.counts.products_s.append(time.monotonic() - arrived_s)
            self.counts.written += 1

        self._behind.put(finish)

    def _failed(self, pair: Pair, error: Exception) -> None:
        self.counts.failed += 1
        text = str(error)
        self.counts.last_error = text if pair.name in text else f"{pair.name}: {text}"
        self._tell_first(f"a pair failed: {self.counts.last_error}")

    def _tell_first(self, line: str) -> None:
        kind = kind_of(line)
        if kind not in self._kinds and len(self._kinds) < MOST_KINDS:
            self._kinds.add(kind)
            self.tell(line)

    def _may_be_growing(self, pair: Pair) -> bool:
        now_s = time.monotonic()
        if self._tried[0] != pair.name:
            self._tried = (pair.name, now_s)
        return now_s - self._tried[1] < SETTLE_S
