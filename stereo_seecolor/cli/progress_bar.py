"""A progress bar on a terminal."""

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

from stereo_seecolor.progress import Listener
from stereo_seecolor.records import FrameRow


@contextmanager
def bar() -> Iterator[Listener]:
    """A listener that draws a bar for each stage on stderr, with rate, time left, current pair."""
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
