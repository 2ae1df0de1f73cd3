"""``status``: progress or outcome of a run by OUT alone, as it may be on another machine."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from stereo_seecolor.errors import InputError, OutputError, SeeColorError
from stereo_seecolor.extras.fleet.campaign_states import load_states
from stereo_seecolor.extras.fleet.forecast import Forecast
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.frames_csv import read_rows
from stereo_seecolor.run_folder.layout import FRAMES_TABLE
from stereo_seecolor.run_folder.lease import writer
from stereo_seecolor.run_folder.manifest import Manifest

State = Literal["running", "killed", "stopped", "complete", "no run"]
Basis = Literal["", "the plan", "the usual times of the passes"]


@dataclass(frozen=True)
class RunStatus:
    """Progress or outcome of a run. state: "killed": it ended without writing its outcome; "no
    run": the folder holds none.

    stage: the current pass, "" before the first and after the end. done, failed, left: pairs of
    that pass; after the end, of the run. failures: reason, number, first frame; the most frequent
    first. writer: the process that writes into OUT now, "" for none.
    remaining_s: seconds until the pass ends at the rate so far; None where unknown. to_come: passes
    after it.
    run_remaining_s: seconds until all passes end, from the passes' expected times scaled by the
    rate so far, without fits, page and map; None where unknown. rests_on: the source of the
    expected times. problem: why the folder holds no run that can be read, where it should.
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
    to_come: Sequence[str] = ()
    run_remaining_s: float | None = None
    rests_on: Basis = ""
    problem: str = ""


def statuses(outs: Sequence[Path]) -> list[RunStatus]:
    """The status of the runs in these folders, or of the dives of a campaign's. Raises InputError
    where none holds a run.
    """
    folders: dict[Path, bool] = {}  # whether it should hold a run
    for out in outs:
        dives = load_states(out).values()
        folders |= {out / dive.name: dive.state != "not begun" for dive in dives} or {out: True}
    found: list[RunStatus] = []
    problems: list[SeeColorError] = []
    for folder, begun in folders.items():
        try:
            found.append(status(folder))
        except (InputError, OutputError) as error:
            problems.append(error)
            problem = str(error) if begun else ""
            found.append(RunStatus(folder, "no run", "", 0, 0, 0, problem=problem))
    if problems and len(problems) == len(folders):
        raise problems[0]
    return found


def status(out: Path) -> RunStatus:
    """The status of the run in ``out``. Raises InputError if it holds none."""
    now, progress = writer(out), Forecast.load(out)
    if now:
        return (
            _pass_status(out, "running", progress, now)
            if progress
            else RunStatus(out, "running", "", 0, 0, 0, writer=now)
        )
    manifest = Manifest(out)
    if manifest.exists() and manifest.dive().state == "running" and progress:
        return _pass_status(out, "killed", progress, "")
    run = open_run(out)
    rows = read_rows(out / FRAMES_TABLE)
    summary = RunSummary(rows)
    failures = RunSummary([row for row in rows if row.status == "failed"]).problems()
    counts = summary.count("ok"), summary.count("failed"), summary.count("pending")
    return RunStatus(out, run.state, "", *counts, failures)


def _pass_status(out: Path, state: State, progress: Forecast, now: str) -> RunStatus:
    left = progress.total - progress.done
    counts = progress.done - progress.failed, progress.failed, left
    found = RunStatus(out, state, progress.stage, *counts, progress.failures, now)
    if not now:
        return found
    run_s = _until(progress.run_ends_s)
    basis: Basis = (
        ""
        if run_s is None
        else "the plan"
        if progress.expected.planned
        else "the usual times of the passes"
    )
    return replace(
        found,
        remaining_s=_until(progress.ends_s),
        run_remaining_s=run_s,
        to_come=tuple(progress.to_come),
        rests_on=basis,
    )


def _until(ends_s: float | None) -> float | None:
    """Seconds from now to a time in seconds since 1970, at least 0; None for None."""
    return None if ends_s is None else max(ends_s - time.time(), 0.0)
