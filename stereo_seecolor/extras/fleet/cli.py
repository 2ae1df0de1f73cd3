"""Commands for many machines and many dives: merge, status, campaign, plan."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import SIDES, command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.interrupts import EXIT_INTERRUPTED
from stereo_seecolor.cli.report import BareReport, LoggedReport, Report, computing
from stereo_seecolor.cli.result_texts import page_text, run_text
from stereo_seecolor.cli.results import run_content, run_exit_code
from stereo_seecolor.extras.fleet.texts import campaign_text, plan_text, status_text
from stereo_seecolor.run_folder.layout import INDEX


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
    code = EXIT_SOME_FAILED if any(run.problem for run in found) else EXIT_DONE
    report.end({"runs": found}, status_text(found), code)


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
        opt.flag(
            "--only-failed",
            "Run only dives that are not finished, or have failed pairs or problems.",
        ),
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
