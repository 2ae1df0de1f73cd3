"""Commands for many machines and many dives: merge, status, campaign, plan."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import SIDES, command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED
from stereo_seecolor.cli.report import BareReport, LoggedReport, Report, computing
from stereo_seecolor.cli.result_texts import page_text, run_text
from stereo_seecolor.cli.results import run_content, run_exit_code
from stereo_seecolor.cli.text import duration, lines, table
from stereo_seecolor.run_folder.layout import INDEX

if TYPE_CHECKING:
    from stereo_seecolor.extras.fleet.campaign import CampaignResult
    from stereo_seecolor.extras.fleet.plan import Plan
    from stereo_seecolor.extras.fleet.status import RunStatus


@command(
    "Many machines, many dives",
    "merge PARTS/1 PARTS/2 --out OUT",
    "merge PARTS/1 PARTS/2 --out OUT --fit-only",
)
def merge(
    parts: Annotated[
        list[Path], typer.Argument(metavar="PART...", help="Output folders of run --shard.")
    ],
    out: opt.Out = Path("out"),
    fit_only: Annotated[
        bool,
        opt.flag(
            "--fit-only",
            ("Stop after fitting water.json; run --shard --water then uses it on all machines."),
        ),
    ] = False,
    partial: Annotated[
        bool,
        opt.flag(
            "--partial",
            (
                "Merge even if shards are missing; summary, run.json and page name them, "
                "exit code 3."
            ),
        ),
    ] = False,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    cluster: opt.ClusterName = "",
    overwrite: opt.Overwrite = False,
    *,
    report: Report,
) -> None:
    """Join the shards of a dive into one output folder, with one set of water parameters; fuse then
    makes the map.
    """
    from stereo_seecolor.extras.fleet.merge import merge as join

    with report.working() as listener, computing(cluster, report.notice) as compute:
        options = replace(
            opt.Execution(overwrite).options(workers, None, listener), cluster=compute
        )
        summary = join(parts, out, options, fit_only=fit_only, partial=partial)
    page = "" if fit_only or summary.stopped else page_text(out / INDEX)
    report.end(run_content(summary, out), run_text(summary, out) + page, run_exit_code(summary))


@command("Many machines, many dives", "status OUT", "status PARTS/1 PARTS/2")
def status(
    outs: Annotated[
        list[Path],
        typer.Argument(
            metavar="OUT...", help="Output folders of runs, finished or running, or of campaigns."
        ),
    ],
    report: BareReport,
) -> None:
    """Show the progress of runs on any machine: pairs done, failed (with reasons) and left, and the
    expected end.
    """
    from stereo_seecolor.extras.fleet.status import statuses

    found = statuses(outs)
    report.end({"runs": found}, status_text(found))


@command(
    "Many machines, many dives", "campaign campaign.yaml", "campaign campaign.yaml --only-failed"
)
def campaign(
    file: Annotated[
        Path,
        typer.Argument(metavar="CAMPAIGN", help="YAML file that lists the dives (docs/fleets.md)."),
    ],
    only_failed: Annotated[
        bool,
        opt.flag("--only-failed", "Run only dives that are not finished or have failed pairs."),
    ] = False,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    cluster: opt.ClusterName = "",
    *,
    report: Report,
) -> None:
    """Run many dives, one after the other; a failed dive does not stop the others."""
    from stereo_seecolor.extras.fleet.campaign import campaign as run_all

    with report.working() as listener, computing(cluster, report.notice) as compute:
        options = replace(opt.Execution().options(workers, None, listener), cluster=compute)
        result = run_all(file, options, only_failed=only_failed)
    stopped = any(dive.state == "stopped" for dive in result.dives)
    code = EXIT_INTERRUPTED if stopped else EXIT_DONE if result.all_done else EXIT_SOME_FAILED
    report.end(vars(result), campaign_text(result), code)


@command("Many machines, many dives", f"plan {SIDES}")
def plan(
    left: opt.Left,
    right: opt.Right,
    calib: opt.Calib,
    out: Annotated[
        Path | None,
        opt.option(
            "--out",
            "FOLDER",
            (
                "Save the plan in this folder; a run into the same folder compares its cost "
                "with the plan."
            ),
        ),
    ] = None,
    *,
    settings: opt.Settings,
    report: LoggedReport,
) -> None:
    """Estimate the cost of a dive from ten of its pairs: core-hours, time by number of workers,
    disk, memory.
    """
    from stereo_seecolor.extras.fleet.plan import plan as measure

    with report.working():
        found = measure(left, right, calib, settings.load(), out)
    report.end({**vars(found), "core_hours": found.core_hours}, plan_text(found))


# The status of runs, the outcome of a campaign, and the cost of a dive, as text.

REMEDY = {
    "killed": "ended unexpectedly: run its command again",
    "stopped": "stopped early: run its command again",
    "no run": "holds no run",
}


def status_text(runs: "Sequence[RunStatus]") -> str:
    """A table with a row for each run, then a table of errors with their number in each run."""
    rows = [
        (
            str(run.out),
            run.state,
            run.stage,
            str(run.done),
            str(run.failed),
            str(run.left),
            _end(run),
        )
        for run in runs
    ]
    failures = [
        (str(often), f"{run.out}: {first}", what)
        for run in runs
        for what, often, first in run.failures
    ]
    return table(("run", "state", "pass", "done", "failed", "left", ""), rows) + (
        lines("") + table(("times", "first in", "what went wrong"), failures) if failures else ""
    )


def _end(run: "RunStatus") -> str:
    if run.state in REMEDY:
        return REMEDY[run.state]
    by = f"by {run.writer}" if run.writer else ""
    left = f"{duration(run.remaining_s)} left" if run.remaining_s is not None else ""
    return ", ".join(part for part in (left, _run_end(run), by) if part)


def _run_end(run: "RunStatus") -> str:
    """The expected end of an active run, and the parts that the estimate leaves out; "" for other
    runs.
    """
    if run.state != "running":
        return ""
    then = f"then {', '.join(run.to_come)}; " if run.to_come else ""
    if run.run_remaining_s is None:
        return f"end of the run unknown ({then}page, map)" if run.stage else "begins"
    return (
        f"{duration(run.run_remaining_s)} to the end of the run ({then}page and map not "
        f"counted; by {run.rests_on})"
    )


def campaign_text(result: "CampaignResult") -> str:
    """A table with a row for each dive."""
    rows = [
        (dive.name, dive.state, str(dive.ok), str(dive.failed), duration(dive.seconds), dive.error)
        for dive in result.dives
    ]
    return table(("dive", "state", "pairs", "failed", "time", ""), rows) + lines(str(result.table))


def plan_text(plan: "Plan") -> str:
    """The estimated cost of a dive, and a table of time by number of workers."""
    stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in plan.stage_seconds.items())
    hours = [(str(workers), duration(3600 * hours)) for workers, hours in plan.wall_hours.items()]
    return lines(
        f"{plan.pairs} pairs, {plan.measured} of them measured: {plan.core_seconds_per_pair:.2f} "
        f"core-seconds each ({stages})",
        f"{plan.core_hours:.3g} core-hours, {plan.fit_s:.1f} s of them for work that is done once",
        f"{plan.disk_bytes / 1e9:.3g} GB of results; {plan.memory_bytes / 1e9:.2g} GB of memory "
        "for one worker",
    ) + table(("workers of one core", "time"), hours)
