"""Commands on the calibration of a rig: calibrate, check, convert-calib."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import SIDES, command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.report import BareReport, LoggedReport, Report
from stereo_seecolor.cli.results import calibration_content, check_content
from stereo_seecolor.cli.text import lines

if TYPE_CHECKING:
    from stereo_seecolor.commands.calibrate import CalibrationResult
    from stereo_seecolor.commands.check import CheckResult, RigFacts

Target = Annotated[
    str,
    opt.option(
        "--target",
        "TARGET",
        "chessboard:9x6:24.23mm (inner corners), charuco:5X5_100:11x8:30mm:22mm (squares, marker), "
        "aprilgrid:6x6:88mm:26.4mm (tags, space), or a Kalibr target file.",
    ),
]
TargetLeft = Annotated[
    Path | None, opt.option("--left", "FOLDER", "Folder of left images of the target, or a video.")
]
TargetRight = Annotated[
    Path | None, opt.option("--right", "FOLDER", "Folder of right images of the target.")
]
CalibrationOut = Annotated[
    Path,
    opt.option(
        "--out",
        "FILE",
        ("Calibration file to write; a picture of the coverage is written into the same folder."),
    ),
]
Medium = Annotated[
    Literal["water", "air"],
    opt.option(
        "--medium",
        None,
        "Where the images of the target were taken; calibrate in water if you can.",
    ),
]
PrintTarget = Annotated[
    Path | None,
    opt.option(
        "--print-target", "FILE", "Write the target to this .pdf or .png and stop.", opt.SETTINGS
    ),
]
Dpi = Annotated[int, opt.option("--dpi", "N", "Resolution of a .png target.", opt.SETTINGS, min=10)]
Pairs = Annotated[
    int, opt.option("--pairs", "N", "Number of pairs to test, spread evenly over the dive.", min=1)
]
Refine = Annotated[
    Path | None,
    opt.option(
        "--refine",
        "FILE",
        "Refine the calibration on the dive, and write the refined rig to this file.",
    ),
]
Source = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="Any calibration of docs/calibration.md: a file, a folder, or left.yaml,right.yaml.",
    ),
]
Converted = Annotated[
    str,
    typer.Argument(metavar="OUT", help="File to write; for ros a folder, or left.yaml,right.yaml."),
]
Format = Annotated[
    Literal["native", "ros", "kalibr", "opencv", "matlab", "viame"],
    opt.option("--to", None, "Format to write."),
]
Size = Annotated[
    str | None,
    opt.option(
        "--size", "WIDTHxHEIGHT", "Image size of a calibration that does not state it (OpenCV)."
    ),
]
Resize = Annotated[
    str | None,
    opt.option(
        "--resize",
        "WIDTHxHEIGHT",
        "Size of the dive's images, if they were binned or resized after the calibration.",
    ),
]


@command(
    "Calibration",
    "calibrate --target chessboard:9x6:24mm --print-target board.pdf",
    "calibrate --target chessboard:9x6:24mm --left BOARD/left --right BOARD/right",
)
def calibrate(
    target: Target,
    left: TargetLeft = None,
    right: TargetRight = None,
    out: CalibrationOut = Path("cam.yaml"),
    medium: Medium = "water",
    print_target: PrintTarget = None,
    dpi: Dpi = 300,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    *,
    report: Report,
) -> None:
    """Calibrate a rig from image pairs of a chessboard, ChArUco board or AprilGrid
    (docs/calibration.md); exit code 3 if the verdict is "do it again".
    """
    from stereo_seecolor.commands import calibrate as commands
    from stereo_seecolor.dive.run_options import RunOptions

    if print_target:
        commands.print_target(target, print_target, dpi)
        report.end(
            {"target": print_target},
            f"{print_target}: print it at 100 %, glue it flat, and measure it\n",
        )
    if left is None or right is None:
        raise typer.BadParameter("give --left and --right, the image folders, or --print-target")
    with report.working() as listener:
        result = commands.calibrate(
            left, right, target, out, medium, RunOptions(workers, listener=listener)
        )
    code = EXIT_SOME_FAILED if result.report.is_wrong else EXIT_DONE
    report.end(calibration_content(result), calibration_text(result), code)


@command("A dive", f"check {SIDES}", f"check {SIDES} --refine refined.yaml")
def check(
    left: opt.Left,
    right: opt.Right,
    calib: opt.Calib,
    pairs: Pairs = 12,
    refine: Refine = None,
    *,
    settings: opt.Settings,
    report: LoggedReport,
) -> None:
    """Test a calibration against the images of a dive; exit code 3 if numbers of a run would be
    wrong.
    """
    from stereo_seecolor.commands.check import check as test

    with report.working():
        result = test(left, right, calib, pairs, refine, settings.load().input)
    code = EXIT_SOME_FAILED if result.is_wrong else EXIT_DONE
    report.end(check_content(result), check_text(result), code)


@command(
    "Calibration",
    "convert-calib stereo.mat cam.yaml",
    "convert-calib cam.yaml ROS --to ros",
    "convert-calib camchain.yaml cam.yaml",
)
def convert_calib(
    source: Source,
    out: Converted,
    to: Format = "native",
    size: Size = None,
    resize: Resize = None,
    *,
    report: BareReport,
) -> None:
    """Convert a calibration into another format, with the same ray for every pixel; exit code 3 if
    the file can be read in several ways, one of which was taken.
    """
    from stereo_seecolor.commands.convert_calib import convert_calib as convert

    result = convert(source, out, to, size, resize)
    output = [
        f"{result.out}: {result.format}, baseline {result.baseline_m * 1000:.1f} mm",
        *(f"note: {note}" for note in result.notes),
    ]
    code = EXIT_SOME_FAILED if result.readings > 1 else EXIT_DONE
    report.end(vars(result), lines(*output), code)


def calibration_text(result: "CalibrationResult") -> str:
    """The quality of a new calibration, and its files."""
    return lines(
        *result.report.lines(),
        f"  {result.calibration}: the calibration",
        f"  {result.coverage}: positions of the corners in the images",
    )


def check_text(result: "CheckResult") -> str:
    """Results of `check`: numbers of the rig, suspicions, rows, and the refined rig."""
    suspicious = (f"suspicious: {text}" for text in result.suspicions)
    notes = (f"note: {note}" for note in result.images.notes)
    output = [*_rig_lines(result.rig), *suspicious, *notes, *result.rows.lines()]
    if result.refined is not None:
        rows = result.refined_rows
        after = [f"refined: {line}" for line in ([rows.motion.line, *rows.advice] if rows else [])]
        output += [
            *result.refined.lines(),
            *after,
            f"  {result.refined_file}: the refined calibration",
        ]
    return lines(*output)


def _rig_lines(rig: "RigFacts") -> list[str]:
    width, height = rig.image_size
    output = [
        f"{rig.camera_model} cameras of {width}x{height} px, baseline "
        f"{rig.baseline_m * 1000:.1f} mm, calibrated in {rig.medium}",
        f"rectified: focal length {rig.focal_px:.1f} px, {rig.field_deg:.0f} degrees across; a "
        f"point at 1 m has a disparity of {rig.disparity_at_1_m_px:.1f} px",
    ]
    if rig.port == "flat":
        listed = ", ".join(f"{error:.2%} at {range_m:.2g} m" for range_m, error in rig.port_error)
        output.append(
            f"flat port, exact at {rig.working_range_m:g} m; range error left elsewhere: {listed}"
        )
    elif rig.port == "dome":
        output.append("dome port, assumed to be centered on the cameras: no correction")
    return output
