"""Progress: a bar on a terminal, lines for a log, JSON lines for a program."""

import time

from stereo_seecolor.cli.output import write_error
from stereo_seecolor.cli.text import lines
from stereo_seecolor.files.json_values import json_line
from stereo_seecolor.records import FrameRow

LINE_EVERY_S = 10.0
"""Seconds between lines of one stage: it is seen to work, in 360 lines an hour at most."""


class PlainLines:
    """A listener that writes a line when a stage begins and ends, every LINE_EVERY_S between, and
    for each failed pair.
    """

    def __init__(self) -> None:
        self._stage, self._done, self._total = "", 0, 0
        self._began_s = self._reported_s = 0.0

    def begin(self, stage: str, total: int) -> None:
        """A stage begins."""
        self._stage, self._done, self._total = stage, 0, total
        self._began_s = self._reported_s = time.monotonic()
        write_error(f"{stage}: 0 of {total}\n")

    def advance(self, row: FrameRow) -> None:
        """One more pair."""
        self._done += 1
        now_s = time.monotonic()
        if row.status == "failed":
            write_error(lines(row.line))
        if self._done == self._total or now_s - self._reported_s >= LINE_EVERY_S:
            self._reported_s = now_s
            write_error(
                f"{self._stage}: {self._done} of {self._total}, {now_s - self._began_s:.1f} s\n"
            )


class JsonLines:
    """A listener that writes a JSON object as a stage begins and for each pair (docs/json.md)."""

    def __init__(self) -> None:
        self._stage, self._done, self._total = "", 0, 0
        self._began_s = time.monotonic()

    def begin(self, stage: str, total: int) -> None:
        """A stage begins."""
        self._stage, self._done, self._total = stage, 0, total
        self._began_s = time.monotonic()
        write_error(json_line({"event": "begin", "stage": stage, "total": total}))

    def advance(self, row: FrameRow) -> None:
        """One more pair."""
        self._done += 1
        event = {
            "event": "advance",
            "stage": self._stage,
            "done": self._done,
            "total": self._total,
            "name": row.name,
        }
        outcome = {
            "status": row.status,
            "error": row.error,
            "warnings": row.warnings,
            "kept": row.kept,
        }
        write_error(
            json_line({**event, **outcome, "seconds": round(time.monotonic() - self._began_s, 3)})
        )
