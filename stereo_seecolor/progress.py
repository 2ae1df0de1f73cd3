"""Listeners, which receive the progress events of a command."""

import logging
import re
import time
from typing import Protocol

from stereo_seecolor.records import FrameRow

LOG_EVERY_S = 60.0
"""Seconds between two log lines of a stage: how far a long run had come before a crash."""

log = logging.getLogger(__name__)
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


class Listener(Protocol):
    """Receives progress events of a command: cli/ has listeners that draw it."""

    def begin(self, stage: str, total: int) -> None:
        """A pass over ``total`` pairs begins."""

    def advance(self, row: FrameRow) -> None:
        """A pair has finished the pass."""


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
        """Tell both that a pass begins."""
        for listener in self._listeners:
            listener.begin(stage, total)

    def advance(self, row: FrameRow) -> None:
        """Tell both of a finished pair."""
        for listener in self._listeners:
            listener.advance(row)


class LoggingListener:
    """Writes progress to the log, and passes it on; each kind of warning once."""

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
        """Log a pair's error and warnings, and every LOG_EVERY_S the progress of the stage."""
        self._done += 1
        if row.status == "failed":
            self._failed += 1
            log.error("%s: %s", self._stage, row.line)
        for warning in row.warnings:
            kind = _NUMBER.sub("", warning)
            log.log(
                logging.DEBUG if kind in self._kinds else logging.WARNING,
                "%s: %s: %s",
                self._stage,
                row.name,
                warning,
            )
            self._kinds.add(kind)
        now_s = time.monotonic()
        if self._done == self._total or now_s - self._reported_s >= LOG_EVERY_S:
            self._reported_s = now_s
            seconds = now_s - self._began_s
            log.info(
                "%s: %d of %d, %d failed, %.1f s",
                self._stage,
                self._done,
                self._total,
                self._failed,
                seconds,
            )
        self._then.advance(row)
