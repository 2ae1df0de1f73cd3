"""How far a job is: a bar on a terminal, silence elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from stereo_seecolor.progress import Listener, Silence
from stereo_seecolor.run_folder.frames_table import FrameRow


@contextmanager
def progress(quiet: bool = False) -> Iterator[Listener]:
    """A listener that draws a bar with rate, time left and the present pair on standard error, if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield Silence()
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[pair]}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        yield _Bar(bar)


class _Bar:
    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._task: TaskID | None = None

    def begin(self, stage: str, total: int) -> None:
        """A new line for each pass."""
        self._task = self._bar.add_task(stage, total=total, rate="", pair="")

    def advance(self, row: FrameRow) -> None:
        """One more pair; a failed one is named above the bar at once."""
        if self._task is None:
            return
        if row.status == "failed":
            self._bar.console.print(row.line, markup=False)
        speed = self._bar.tasks[self._task].speed
        self._bar.update(self._task, advance=1, pair=row.name, rate=f"{speed:.1f}/s" if speed else "")
