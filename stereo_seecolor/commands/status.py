"""``status``: how far a run is, or what became of it, from OUT alone: it may run on another machine."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.layout import FRAMES_TABLE
from stereo_seecolor.run_folder.lease import writer
from stereo_seecolor.run_folder.manifest import Manifest
from stereo_seecolor.run_folder.part import read_rows
from stereo_seecolor.run_folder.progress_file import Progress

State = Literal["running", "killed", "stopped", "complete"]


@dataclass(frozen=True)
class RunStatus:
    """A run of some pairs. state: killed is a run that ended without a word.

    stage: the pass that it is in, "" after the end. done, failed, left: pairs of that pass, or of the run after the end.
    failures: reason, how often, first frame, the most frequent first. writer: who writes into OUT now.
    remaining_s: seconds until the pass ends at the rate so far; None where that is not known. A second pass may follow.
    """

    out: Path
    state: State
    stage: str
    done: int
    failed: int
    left: int
    failures: Sequence[tuple[str, int, str]] = ()
    writer: str = ""
    remaining_s: float | None = None


def status(out: Path) -> RunStatus:
    """How far the run in ``out`` is. Raises InputError if it holds none."""
    now, progress = writer(out), Progress.load(out)
    if now and progress:
        return _pass_status(out, "running", progress, now)
    manifest = Manifest(out)
    if manifest.exists() and manifest.dive().state == "running" and progress:
        return _pass_status(out, "killed", progress, "")
    run = open_run(out)
    rows = read_rows(out / FRAMES_TABLE)
    summary = RunSummary(rows)
    failures = RunSummary([row for row in rows if row.status == "failed"]).problems()
    counts = summary.count("ok"), summary.count("failed"), summary.count("pending")
    return RunStatus(out, run.state, "", *counts, failures)


def _pass_status(out: Path, state: State, progress: Progress, now: str) -> RunStatus:
    remaining_s = max(progress.ends_s - time.time(), 0.0) if now and progress.ends_s else None
    left = progress.total - progress.done
    return RunStatus(
        out, state, progress.stage, progress.done - progress.failed, progress.failed, left, progress.failures, now, remaining_s
    )
