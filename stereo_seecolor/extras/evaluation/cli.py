"""Commands that need or make known truth: evaluate, synthesize, demo."""

from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.contents import run_content, run_exit_code
from stereo_seecolor.cli.report import LoggedReport, Report
from stereo_seecolor.cli.run_text import run_text
from stereo_seecolor.extras.evaluation.text import charts_text, spread_text, truth_text

CHARTS = "Color charts"
FinishedRun = Annotated[
    Path | None, typer.Argument(metavar="OUT", help="Output folder of a finished run (for --truth and --spread).")
]
Truth = Annotated[Path | None, opt.option("--truth", "FOLDER", "The truth/ folder of a dive made by synthesize.")]
BySpread = Annotated[bool, opt.flag("--spread", "Compare the same spots of the reef between the frames of OUT; needs no truth.")]
ByChart = Annotated[bool, opt.flag("--chart", "Score every method on color charts or white targets.", CHARTS)]
Images = Annotated[
    Path | None,
    opt.option(
        "--images",
        "FOLDER",
        "Folder of uncorrected images whose pixels are those of the range maps, as rectify writes them.",
        CHARTS,
    ),
]
Ranges = Annotated[Path | None, opt.option("--range", "FOLDER", "Folder of their range maps.", CHARTS)]
Targets = Annotated[
    Path | None, opt.option("--targets", "FILE", "JSON of chart corners and polygons. Default: charts are searched for.", CHARTS)
]
Others = Annotated[
    list[Path] | None,
    opt.option(
        "--others",
        "FOLDER",
        "Results of another tool: a folder of images with the same names (for --spread of the rectified ones). May be repeated.",
        CHARTS,
    ),
]
Sheet = Annotated[Path, opt.option("--sheet", "FILE", "Contact sheet to write, PNG.", CHARTS)]
PairCount = Annotated[int, opt.option("--pairs", "N", "Number of stereo pairs.", min=1)]
LineCount = Annotated[int, opt.option("--lines", "N", "Number of parallel survey lines.", min=1)]
ImageSize = Annotated[str, opt.option("--size", "WIDTHxHEIGHT", "Image size in pixels.")]
WaterName = Annotated[str, opt.option("--water", "NAME", "Kind of water: blue-ocean, coastal-green or turbid.")]
Seed = Annotated[int, opt.option("--seed", "N", "Random seed; each gives another reef and track.", min=0)]


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
    *,
    settings: opt.Settings,
    report: LoggedReport,
) -> None:
    """Measure quality: errors against truth (--truth), differences between views (--spread), errors on charts (--chart)."""
    from stereo_seecolor.extras.evaluation.charts import evaluate_charts
    from stereo_seecolor.extras.evaluation.evaluate import evaluate as evaluate_run
    from stereo_seecolor.extras.evaluation.evaluate import evaluate_spread

    if by_chart:
        if images is None or ranges is None:
            raise typer.BadParameter("--chart needs --images and --range")
        with report.working():
            charts = evaluate_charts(images, ranges, targets, settings.load(), sheet, others or ())
        report.end({**vars(charts), "means": charts.means()}, charts_text(charts))
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
    out: opt.Out = Path("dive"),
    pairs: PairCount = 12,
    lines: LineCount = 2,
    size: ImageSize = "640x512",
    water: WaterName = "blue-ocean",
    seed: Seed = 7,
    *,
    report: Report,
) -> None:
    """Render a dive over a reef with known truth (docs/synthetic.md)."""
    from stereo_seecolor.extras.synthetic.dive import parse_spec
    from stereo_seecolor.extras.synthetic.synthesize import synthesize as render

    with report.working() as listener:
        dive = render(parse_spec(pairs=pairs, lines=lines, size=size, water=water, seed=seed), out, listener)
    text = f"{pairs} pairs in {out}: left/, right/, cam.yaml, trajectory.tum, and the truth in truth/\n"
    report.end({"out": dive.out, "spec": dive.spec}, text)


def demo(out: opt.Out = Path("demo"), workers: opt.Workers = opt.DEFAULT_WORKERS, *, report: Report) -> None:
    """Render a small reef, run the whole job on it, and compare the result with the truth."""
    from stereo_seecolor.dive.run_options import RunOptions
    from stereo_seecolor.extras.synthetic.demo import demo as show

    with report.working() as listener:
        result = show(out, RunOptions(workers, listener=listener))
    text = run_text(result.summary, result.out) + (truth_text(result.truth) if result.truth else "")
    content = {**run_content(result.summary, result.out), "truth": result.truth}
    report.end(content, text, run_exit_code(result.summary))
