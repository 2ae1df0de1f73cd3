"""The status of runs, the outcome of a campaign, and the cost of a dive, as text."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from calibration.errors import counted
from stereo_seecolor.cli.text import duration, lines, table

if TYPE_CHECKING:
    from stereo_seecolor.extras.fleet.campaign import CampaignResult
    from stereo_seecolor.extras.fleet.plan import Plan
    from stereo_seecolor.extras.fleet.status import RunStatus

REMEDY = {
    "killed": "ended unexpectedly: run its command again",
    "stopped": "stopped early: run its command again",
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
    if run.problem or run.state in REMEDY:
        return run.problem or REMEDY[run.state]
    by = f"by {run.writer}" if run.writer else ""
    left = f"{duration(run.remaining_s)} left" if run.remaining_s is not None else ""
    return ", ".join(part for part in (left, _run_end(run), by) if part)


def _run_end(run: "RunStatus") -> str:
    """The expected end of an active run, and what the estimate leaves out; else ""."""
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
        f"{counted(plan.pairs, 'pair')}, {plan.measured} of them measured: "
        f"{plan.core_seconds_per_pair:.2f} core-seconds each ({stages})",
        f"{plan.core_hours:.3g} core-hours without a map, {plan.fit_s:.1f} s of them for work that "
        "is done once",
        f"{plan.disk_bytes / 1e9:.3g} GB of results; {plan.memory_bytes / 1e9:.2g} GB of memory "
        "for one worker",
    ) + table(("workers of one core", "time"), hours)
