"""Commands on what a map shows: metrics."""

from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.options import AsJson, Finished
from stereo_seecolor.cli.reef_text import metrics_text
from stereo_seecolor.cli.report import Report


def metrics(
    out: Finished,
    polygons: Annotated[
        Path | None,
        typer.Option("--polygons", metavar="FILE", help="Outlines of colonies or bottom types: GeoJSON, or a TagLab project."),
    ] = None,
    folder: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="A new or empty folder for CSV tables.")] = None,
    as_json: AsJson = False,
) -> None:
    """Structure, colonies and cover of a fused run, with standard errors."""
    from stereo_seecolor.commands.metrics import metrics as measure

    report = Report("metrics", as_json)
    with report.working():
        result = measure(out, polygons, folder)
    code = EXIT_SOME_FAILED if result.unseen else EXIT_DONE
    report.end({"out": out, **vars(result)}, metrics_text(result), code)
