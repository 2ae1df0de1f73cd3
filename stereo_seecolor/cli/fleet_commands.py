"""Commands for many machines and many dives: merge, status."""

from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli.contents import run_content, run_exit_code
from stereo_seecolor.cli.fleet_text import status_text
from stereo_seecolor.cli.options import DEFAULT_WORKERS, AsJson, LogFile, Out, Overwrite, Progress, Verbose, Workers
from stereo_seecolor.cli.report import Report, run_options
from stereo_seecolor.cli.run_text import run_text


def merge(
    parts: Annotated[list[Path], typer.Argument(metavar="PART...", help="Output folders of run --shard.")],
    out: Out = Path("out"),
    fit_only: Annotated[
        bool,
        typer.Option("--fit-only", metavar="", help="Stop when water.json is there: run --shard --water corrects on all machines."),
    ] = False,
    workers: Workers = DEFAULT_WORKERS,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
    progress: Progress = "auto",
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Join the results of a dive's shards: one water, one manifest, one frames.csv; fuse then makes the map."""
    from stereo_seecolor.commands.merge import merge as join

    report = Report("merge", as_json, progress, verbose, log_file)
    with report.working() as listener:
        options = run_options(workers, overwrite, False, False, None, listener)
        summary = join(parts, out, options, fit_only=fit_only)
    report.end(run_content(summary, out), run_text(summary, out), run_exit_code(summary))


def status(
    outs: Annotated[list[Path], typer.Argument(metavar="OUT...", help="Output folders of runs, finished or under way.")],
    as_json: AsJson = False,
) -> None:
    """How far runs are, wherever they run: pairs done, failed and why, left, and when the pass ends."""
    from stereo_seecolor.commands.status import status as look

    found = [look(out) for out in outs]
    Report("status", as_json).end({"runs": found}, status_text(found))
