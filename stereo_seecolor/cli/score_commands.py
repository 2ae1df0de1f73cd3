"""Commands that need or make known truth: evaluate, synthesize, demo."""

from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli.contents import charts_content, run_content, run_exit_code
from stereo_seecolor.cli.options import (
    DEFAULT_WORKERS,
    AsJson,
    ConfigFile,
    LogFile,
    Out,
    Progress,
    Settings,
    Verbose,
    Workers,
)
from stereo_seecolor.cli.report import Report
from stereo_seecolor.cli.run_text import run_text
from stereo_seecolor.cli.score_text import charts_text, spread_text, truth_text

CHARTS = "Color charts"
FinishedRun = Annotated[Path | None, typer.Argument(metavar="OUT", help="Output folder of a finished run (with --truth).")]
Truth = Annotated[Path | None, typer.Option("--truth", metavar="FOLDER", help="The truth/ folder of a dive made by synthesize.")]
BySpread = Annotated[
    bool, typer.Option("--spread", metavar="", help="Compare the same spots of the reef between the frames of OUT; needs no truth.")
]
ByChart = Annotated[
    bool, typer.Option("--chart", metavar="", help="Score every method on color charts or white targets.", rich_help_panel=CHARTS)
]
Images = Annotated[
    Path | None, typer.Option("--images", metavar="FOLDER", help="Folder of images as the camera saw them.", rich_help_panel=CHARTS)
]
Ranges = Annotated[
    Path | None, typer.Option("--range", metavar="FOLDER", help="Folder of their range maps.", rich_help_panel=CHARTS)
]
Targets = Annotated[
    Path | None,
    typer.Option(
        "--targets", metavar="FILE", help="JSON of chart corners and polygons; without it charts are found.", rich_help_panel=CHARTS
    ),
]
Others = Annotated[
    list[Path] | None,
    typer.Option(
        "--others",
        metavar="FOLDER",
        help="Folder of what another tool made of the images (with --spread of rectified ones), under the same names; once a tool.",
        rich_help_panel=CHARTS,
    ),
]
Sheet = Annotated[Path, typer.Option("--sheet", metavar="FILE", help="Contact sheet to write, PNG.", rich_help_panel=CHARTS)]
PairCount = Annotated[int, typer.Option("--pairs", metavar="N", min=1, help="Number of stereo pairs.")]
LineCount = Annotated[int, typer.Option("--lines", metavar="N", min=1, help="Number of survey lines, flown to and fro.")]
ImageSize = Annotated[str, typer.Option("--size", metavar="WIDTHxHEIGHT", help="Image size in pixels, as WIDTHxHEIGHT.")]
WaterName = Annotated[str, typer.Option("--water", metavar="NAME", help="blue-ocean, coastal-green or turbid.")]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Another number gives another reef and another track.")]


def evaluate(
    out: FinishedRun = None,
    truth: Truth = None,
    by_chart: ByChart = False,
    images: Images = None,
    ranges: Ranges = None,
    targets: Targets = None,
    others: Others = None,
    sheet: Sheet = Path("charts.png"),
    by_spread: BySpread = False,
    config: ConfigFile = None,
    settings: Settings = None,
    as_json: AsJson = False,
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Errors of a run against truth (--truth); how evenly it shows the reef (--spread); errors of methods on targets (--chart)."""
    from stereo_seecolor.commands.evaluate import evaluate as evaluate_run
    from stereo_seecolor.commands.evaluate import evaluate_spread
    from stereo_seecolor.config_file import load_config
    from stereo_seecolor.evaluation.charts import evaluate_charts

    report = Report("evaluate", as_json, "none", verbose, log_file)
    if by_chart:
        if images is None or ranges is None:
            raise typer.BadParameter("--chart needs --images and --range")
        with report.working():
            charts = evaluate_charts(images, ranges, targets, load_config(config, settings or []), sheet, others or ())
        report.end(charts_content(charts), charts_text(charts))
    if out is not None and by_spread:
        with report.working():
            spread = evaluate_spread(out, others or ())
        report.end(vars(spread), spread_text(spread))
    if out is None or truth is None:
        raise typer.BadParameter("give a run's folder with --truth or --spread, or --chart with --images and --range")
    with report.working():
        scores = evaluate_run(out, truth)
    report.end(vars(scores), truth_text(scores))


def synthesize(
    out: Out = Path("dive"),
    pairs: PairCount = 12,
    lines: LineCount = 2,
    size: ImageSize = "640x512",
    water: WaterName = "blue-ocean",
    seed: Seed = 7,
    as_json: AsJson = False,
    progress: Progress = "auto",
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Render a dive over a reef with known truth (docs/synthetic.md)."""
    from stereo_seecolor.commands.synthesize import synthesize as render
    from stereo_seecolor.synthetic.dive import parse_spec

    report = Report("synthesize", as_json, progress, verbose, log_file)
    with report.working() as listener:
        dive = render(parse_spec(pairs=pairs, lines=lines, size=size, water=water, seed=seed), out, listener)
    text = f"{pairs} pairs in {out}: left/, right/, cam.yaml, trajectory.tum, and the truth in truth/\n"
    report.end({"out": dive.out, "spec": dive.spec}, text)


def demo(
    out: Out = Path("demo"),
    workers: Workers = DEFAULT_WORKERS,
    as_json: AsJson = False,
    progress: Progress = "auto",
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Render a small reef, run the whole job on it, and compare the result with the truth."""
    from stereo_seecolor.commands.demo import demo as show
    from stereo_seecolor.progress import RunOptions

    report = Report("demo", as_json, progress, verbose, log_file)
    with report.working() as listener:
        result = show(out, RunOptions(workers, listener=listener))
    text = run_text(result.summary, result.out) + (truth_text(result.truth) if result.truth else "")
    content = {**run_content(result.summary, result.out), "truth": result.truth}
    report.end(content, text, run_exit_code(result.summary))
