"""Commands that measure the quality of a run, and its water parameters: evaluate, water."""

from pathlib import Path
from typing import Annotated

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.report import LoggedReport
from stereo_seecolor.extras.evaluation.score_texts import (
    charts_text,
    spread_text,
    truth_text,
    water_text,
)

CHARTS = "Color charts"
FinishedRun = Annotated[
    Path | None,
    typer.Argument(
        metavar="OUT", help="Output folder of a finished run (for --truth and --spread)."
    ),
]
Truth = Annotated[
    Path | None,
    opt.option("--truth", "FOLDER", "The truth/ folder of a dive that synthesize made."),
]
BySpread = Annotated[
    bool,
    opt.flag(
        "--spread",
        ("Compare the same spots of the reef between the frames of OUT; needs no ground truth."),
    ),
]
ByChart = Annotated[
    bool, opt.flag("--chart", "Score every method on color charts or white targets.", CHARTS)
]
Images = Annotated[
    Path | None,
    opt.option(
        "--images",
        "FOLDER",
        "Folder of uncorrected images with the same pixels as the range maps, as rectify "
        "writes them.",
        CHARTS,
    ),
]
Ranges = Annotated[
    Path | None, opt.option("--range", "FOLDER", "Folder of their range maps.", CHARTS)
]
Targets = Annotated[
    Path | None,
    opt.option(
        "--targets",
        "FILE",
        "JSON of chart corners and polygons. Default: charts are detected.",
        CHARTS,
    ),
]
Others = Annotated[
    list[str] | None,
    opt.option(
        "--others",
        "[NAME=]FOLDER",
        "Results of another tool: a folder of images with the same names (with --spread "
        "the names of the frames); NAME is the name in the table. May be repeated.",
        CHARTS,
    ),
]
Sheet = Annotated[Path, opt.option("--sheet", "FILE", "Contact sheet to write, PNG.", CHARTS)]


@command(
    "Accuracy",
    "evaluate OUT --truth dive/truth",
    "evaluate OUT --spread",
    "evaluate --chart --images IMAGES --range RANGES",
    "evaluate --chart --images IMAGES --range RANGES --others SEATHRU",
)
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
    """Measure quality: errors relative to ground truth (--truth), differences between views
    (--spread), errors on charts (--chart).
    """
    from stereo_seecolor.extras.evaluation.charts.scores import evaluate_charts
    from stereo_seecolor.extras.evaluation.evaluate_run import evaluate as evaluate_run
    from stereo_seecolor.extras.evaluation.evaluate_run import evaluate_spread

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
        raise typer.BadParameter(
            "give the folder of a run with --truth or --spread, or --chart with --images and "
            "--range"
        )
    with report.working():
        scores = evaluate_run(out, truth)
    report.end(vars(scores), truth_text(scores))


Poses = Annotated[
    Path | None,
    opt.option("--poses", "FILE", "Trajectory of the dive (TUM, KITTI, COLMAP, AUV tables)."),
]


OfCharts = Annotated[
    bool,
    opt.flag(
        "--chart", "White point and color matrix from color charts and white cards in the frames."
    ),
]


WhiteTargets = Annotated[
    Path | None,
    opt.option(
        "--targets", "FILE", "JSON of chart corners and polygons. Default: charts are detected."
    ),
]


WhiteSpots = Annotated[
    list[str] | None,
    opt.option(
        "--white",
        "FRAME:x,y",
        "White point from a white spot: a pixel of a corrected image. May be repeated.",
    ),
]
SandSpots = Annotated[
    list[str] | None,
    opt.option(
        "--sand", "FRAME:x,y", "White point from a spot of carbonate sand. May be repeated."
    ),
]


@command(
    "Single steps of run",
    "water OUT --poses nav.tum",
    "water OUT --chart",
    "water OUT --white FRAME:x,y",
)
def water(
    out: opt.Finished,
    poses: Poses = None,
    chart: OfCharts = False,
    targets: WhiteTargets = None,
    white: WhiteSpots = None,
    sand: SandSpots = None,
    *,
    settings: opt.Settings,
    report: LoggedReport,
) -> None:
    """Measure the water parameters of a run, for run --water: from spots that several frames see
    (--poses), or only the white point from charts (--chart) or known spots (--white, --sand).
    """
    from stereo_seecolor.errors import InputError
    from stereo_seecolor.extras.evaluation.water import measure_water, measure_white

    with report.working():
        if [poses is not None, chart, bool(white or sand)].count(True) != 1:
            raise InputError(
                "water: give --poses FILE for attenuation and backscatter; or for the white "
                "point --chart, or spots with --white or --sand"
            )
        result = (
            measure_water(out, poses, settings.load(run=out))
            if poses
            else measure_white(out, targets, white or (), sand or ())
        )
    report.end({"out": out, **vars(result)}, water_text(result))
