"""How a command goes about its work, and who follows it."""

import logging
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol

from stereo_seecolor.compute.free_memory import at_once
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.shard import WHOLE, Shard
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.records import FrameRow

LOG_EVERY_S = 60.0
"""Seconds between two lines of the log on one stage: enough to see after a crash how far a run of hours had come."""

log = logging.getLogger(__name__)
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


PageTime = Literal["none", "end", "live"]


class Listener(Protocol):
    """Who follows a command's progress; see cli/."""

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins."""

    def advance(self, row: FrameRow) -> None:
        """One more pair is through the pass."""


class Silence:
    """A listener that reports nothing."""

    def begin(self, stage: str, total: int) -> None:
        """Report nothing."""

    def advance(self, row: FrameRow) -> None:
        """Report nothing."""


class Both:
    """Two listeners as one."""

    def __init__(self, first: Listener, second: Listener) -> None:
        self._listeners = first, second

    def begin(self, stage: str, total: int) -> None:
        """A pass begins."""
        for listener in self._listeners:
            listener.begin(stage, total)

    def advance(self, row: FrameRow) -> None:
        """One more pair is through."""
        for listener in self._listeners:
            listener.advance(row)


class LoggingListener:
    """Writes to the log what a listener hears, then passes it on: stages, failed pairs, each kind of warning once."""

    def __init__(self, then: Listener | None = None) -> None:
        self._then = then or Silence()
        self._stage, self._done, self._failed, self._total = "", 0, 0, 0
        self._began_s = self._reported_s = 0.0
        self._kinds: set[str] = set()

    def begin(self, stage: str, total: int) -> None:
        """Log that a stage begins."""
        self._stage, self._done, self._failed, self._total = stage, 0, 0, total
        self._began_s = self._reported_s = time.monotonic()
        log.info("%s: begins, %d in all", stage, total)
        self._then.begin(stage, total)

    def advance(self, row: FrameRow) -> None:
        """Log what is wrong with a pair, and now and then how far the stage is."""
        self._done += 1
        if row.status == "failed":
            self._failed += 1
            log.error("%s: %s", self._stage, row.line)
        for warning in row.warnings:
            kind = _NUMBER.sub("", warning)
            log.log(logging.DEBUG if kind in self._kinds else logging.WARNING, "%s: %s: %s", self._stage, row.name, warning)
            self._kinds.add(kind)
        now_s = time.monotonic()
        if self._done == self._total or now_s - self._reported_s >= LOG_EVERY_S:
            self._reported_s = now_s
            seconds = now_s - self._began_s
            log.info("%s: %d of %d, %d failed, %.1f s", self._stage, self._done, self._total, self._failed, seconds)
        self._then.advance(row)


@dataclass(frozen=True)
class RunOptions:
    """How a command goes about it; what it makes of its inputs is in the configuration.

    workers: pairs under way at once. overwrite: begin again in a used folder. strict: stop at the first bad pair.
    verify: read and hash every input again, also those whose size and time are those of an earlier run.
    config_file: where the settings came from, so that it is never deleted. command_line: for run.json.
    listener: hears how far the job is; by default the log of this module does. notice: is given what a person should know before
    the work begins, a line each; by default to the log. shard: which part of the dive's pairs is done.
    cluster: where the work runs instead of on this machine's threads.
    water: the water.json of an earlier dive, used instead of a fit.
    page: when OUT/index.html is written: never, at the end, or while the run works as well.
    """

    workers: int = 2
    overwrite: bool = False
    strict: bool = False
    verify: bool = False
    config_file: Path | None = None
    command_line: tuple[str, ...] = ()
    listener: Listener = field(default_factory=LoggingListener)
    shard: Shard = WHOLE
    cluster: Compute | None = None
    water: Path | None = None
    page: PageTime = "end"
    notice: Callable[[str], None] = log.info

    def within_memory(self, pair_bytes: float) -> "RunOptions":
        """With no more pairs under way at once than fit into the free memory; says so. A cluster's workers look after their own."""
        fitting = self.workers if self.cluster else at_once(self.workers, pair_bytes)
        if fitting == self.workers:
            return self
        size = f"a pair takes about {pair_bytes / 1e9:.1f} GB while it is worked on"
        self.notice(f"memory: {size}: {fitting} at once instead of {self.workers}, for more are not free")
        return replace(self, workers=fitting)

    @property
    def compute(self) -> Compute:
        """Where the work on pairs and tiles runs."""
        return self.cluster or Threads(self.workers)
