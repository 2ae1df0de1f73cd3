"""Progress: a bar on a terminal, lines for a log, JSON lines for a program."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from stereo_seecolor.cli.output import write_error
from stereo_seecolor.files.json_values import json_line
from stereo_seecolor.progress import Listener
from stereo_seecolor.records import FrameRow

# A progress bar on a terminal.


@contextmanager
def bar() -> Iterator[Listener]:
    """A listener that draws a bar for each stage on standard error, with rate, time left and the
    current pair.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[pair]}", markup=False),
    )
    drawn = Progress(*columns, console=Console(stderr=True))
    try:
        yield _Bar(drawn)
    finally:
        drawn.stop()


class _Bar:
    def __init__(self, drawn: Progress) -> None:
        self._drawn = drawn
        self._task: TaskID | None = None

    def begin(self, stage: str, total: int) -> None:
        """Draw a new bar for a stage."""
        self._drawn.start()  # not before: its thread would keep workers from being forked
        self._task = self._drawn.add_task(stage, total=total, rate="", pair="")

    def advance(self, row: FrameRow) -> None:
        """Advance the bar by a pair; a failed one is named above the bar."""
        if self._task is None:
            return
        if row.status == "failed":
            self._drawn.console.print(row.line, markup=False, highlight=False)
        speed = self._drawn.tasks[self._task].speed
        self._drawn.update(
            self._task, advance=1, pair=row.name, rate=f"{speed:.1f}/s" if speed else ""
        )


# Progress without a terminal: plain lines for a log, or JSON lines for a program; both on
# standard error.

LINE_EVERY_S = 10.0
"""Seconds between two lines of one stage: often enough to see that it works, 360 lines an hour at
most.
"""


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
            write_error(f"{row.line}\n")
        if self._done == self._total or now_s - self._reported_s >= LINE_EVERY_S:
            self._reported_s = now_s
            write_error(
                f"{self._stage}: {self._done} of {self._total}, {now_s - self._began_s:.1f} s\n"
            )


class JsonLines:
    """A listener that writes a line with a JSON object when a stage begins and for each finished
    pair (docs/json.md).
    """

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
