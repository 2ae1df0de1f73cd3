"""Commands on the calibration of a rig: calibrate, check, convert-calib."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.contents import calibration_content, check_content
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.options import (
    DEFAULT_WORKERS,
    SETTINGS,
    AsJson,
    Calib,
    ConfigFile,
    Left,
    LogFile,
    Progress,
    Right,
    Settings,
    Verbose,
    Workers,
)
from stereo_seecolor.cli.report import Report
from stereo_seecolor.cli.rig_text import calibration_text, check_text

Target = Annotated[
    str,
    typer.Option(
        "--target",
        metavar="TARGET",
        help="chessboard:9x6:24.23mm (inner corners) or charuco:5X5_100:11x8:30mm:22mm (squares, marker).",
    ),
]
TargetLeft = Annotated[Path | None, typer.Option("--left", metavar="FOLDER", help="Folder of left images of the target.")]
TargetRight = Annotated[Path | None, typer.Option("--right", metavar="FOLDER", help="Folder of right images of the target.")]
CalibrationOut = Annotated[
    Path, typer.Option("--out", metavar="FILE", help="Calibration file to write; a picture of the coverage is written beside it.")
]
Medium = Annotated[Literal["water", "air"], typer.Option("--medium", help="Where the images were taken; water is best.")]
PrintTarget = Annotated[
    Path | None,
    typer.Option(
        "--print-target", metavar="FILE", help="Draw the target into this .pdf or .png and stop.", rich_help_panel=SETTINGS
    ),
]
Dpi = Annotated[int, typer.Option("--dpi", metavar="N", min=10, help="Resolution of a .png target.", rich_help_panel=SETTINGS)]
Pairs = Annotated[int, typer.Option("--pairs", metavar="N", min=1, help="How many pairs to test, spread evenly over the dive.")]
Refine = Annotated[
    Path | None,
    typer.Option(
        "--refine",
        metavar="FILE",
        help="Estimate what has moved since the calibration, and write the refined rig to this file.",
    ),
]
Source = Annotated[
    str, typer.Argument(metavar="SOURCE", help="Any calibration of docs/calibration.md: a file, a folder, or left.yaml,right.yaml.")
]
Converted = Annotated[str, typer.Argument(metavar="OUT", help="File to write; for ros a folder, or left.yaml,right.yaml.")]
Format = Annotated[Literal["native", "ros", "kalibr", "opencv", "matlab", "viame"], typer.Option("--to", help="Format to write.")]
Size = Annotated[
    str | None, typer.Option("--size", metavar="WIDTHxHEIGHT", help="WIDTHxHEIGHT, for a source that does not state it (OpenCV).")
]
Resize = Annotated[
    str | None,
    typer.Option("--resize", metavar="WIDTHxHEIGHT", help="Size of the images where they were binned or resized since."),
]


def calibrate(
    target: Target,
    left: TargetLeft = None,
    right: TargetRight = None,
    out: CalibrationOut = Path("cam.yaml"),
    medium: Medium = "water",
    print_target: PrintTarget = None,
    dpi: Dpi = 300,
    workers: Workers = DEFAULT_WORKERS,
    as_json: AsJson = False,
    progress: Progress = "auto",
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Calibrate a rig from image pairs of a chessboard or ChArUco board (docs/calibration.md)."""
    from stereo_seecolor.commands import calibrate as commands
    from stereo_seecolor.progress import RunOptions

    report = Report("calibrate", as_json, progress, verbose, log_file)
    if print_target:
        commands.print_target(target, print_target, dpi)
        report.end({"target": print_target}, f"{print_target}: print it at 100 %, glue it flat, and measure it\n")
    if left is None or right is None:
        raise typer.BadParameter("give --left and --right, the folders of images (or --print-target)")
    with report.working() as listener:
        result = commands.calibrate(left, right, target, out, medium, RunOptions(workers, listener=listener))
    report.end(calibration_content(result), calibration_text(result))


def check(
    left: Left,
    right: Right,
    calib: Calib,
    pairs: Pairs = 12,
    refine: Refine = None,
    config: ConfigFile = None,
    settings: Settings = None,
    as_json: AsJson = False,
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Test a calibration against the images of a dive; exit code 3 if they disagree."""
    from stereo_seecolor.commands.check import check as test
    from stereo_seecolor.config_file import load_config

    report = Report("check", as_json, "none", verbose, log_file)
    with report.working():
        result = test(left, right, calib, pairs, refine, load_config(config, settings or []).input)
    code = EXIT_DONE if result.acceptable else EXIT_SOME_FAILED
    report.end(check_content(result), check_text(result), code)


def convert_calib(
    source: Source, out: Converted, to: Format = "native", size: Size = None, resize: Resize = None, as_json: AsJson = False
) -> None:
    """Convert a calibration into another format; the rays of all pixels stay the same."""
    from stereo_seecolor.commands.convert_calib import convert_calib as convert

    result = convert(source, out, to, size, resize)
    report = Report("convert-calib", as_json)
    said = [
        f"{result.out}: {result.format}, baseline {result.baseline_m * 1000:.1f} mm",
        *(f"note: {note}" for note in result.notes),
    ]
    content = {"source": source, "out": out, "format": to, "baseline_m": result.baseline_m, "notes": list(result.notes)}
    report.end(content, lines(said))
