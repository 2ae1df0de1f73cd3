"""The command line: the only place that prints, parses and exits.

Exit codes: 0 all done; 1 a known error, in one line; 2 wrong usage; 3 finished, but some pairs failed or had no partner;
130 interrupted. Unknown errors keep their traceback. Heavy libraries are imported inside the commands that use them.
"""

import inspect
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from stereo_seecolor.compute.allocator import keep_freed_memory
from stereo_seecolor.compute.threads import cores

if TYPE_CHECKING:
    from stereo_seecolor.config import RunConfig
    from stereo_seecolor.evaluation.truth import TruthReport
    from stereo_seecolor.progress import RunOptions
    from stereo_seecolor.run_folder.frames_table import RunSummary

app = typer.Typer(
    name="stereo-seecolor",
    help="Stereo pairs of a reef in, metric range maps, true-color images and colored 3-D maps out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Left = Annotated[Path, typer.Option("--left", help="Folder of left images, or a video.")]
Right = Annotated[
    Path, typer.Option("--right", help="Folder of right images, or a video; the left one again if it shows both side by side.")
]
Calib = Annotated[str, typer.Option("--calib", help="Calibration of the rig: cam.yaml, or any format of docs/calibration.md.")]
Out = Annotated[Path, typer.Option("--out", help="Output folder; run again on the same one to go on where it stopped.")]
ConfigFile = Annotated[Path | None, typer.Option("--config", help="YAML file of settings (docs/configuration.md).")]
Settings = Annotated[list[str] | None, typer.Option("--set", help="One setting, as section.key=value; may be repeated.")]
WaterFile = Annotated[Path | None, typer.Option("--water", help="water.json of an earlier run, used instead of a fit.")]
Poses = Annotated[Path | None, typer.Option("--poses", help="Trajectory of the dive (TUM, KITTI, COLMAP, AUV tables).")]
Workers = Annotated[int, typer.Option("--workers", min=1, help="Pairs under way at once.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Begin anew in a used output folder.")]
Strict = Annotated[bool, typer.Option("--strict", help="Stop at the first bad pair.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON, for scripts.")]

EXIT_DONE, EXIT_KNOWN_ERROR, EXIT_SOME_FAILED, EXIT_INTERRUPTED = 0, 1, 3, 130
DEFAULT_WORKERS = min(cores(), 8)
MOST_NAMED = 20
"""So many bad pairs are named on the terminal; frames.csv names them all."""


@dataclass(frozen=True)
class How:
    """The options that all commands over the pairs of a dive share, and how such a command goes."""

    out: Out = Path("out")
    config: ConfigFile = None
    settings: Settings = None
    workers: Workers = DEFAULT_WORKERS
    overwrite: Overwrite = False
    strict: Strict = False
    as_json: AsJson = False

    def settled(self) -> "RunConfig":
        """The configuration that the options ask for."""
        return _config(self.config, self.settings)

    def go(self, job: "Callable[[RunOptions], RunSummary]") -> int:
        """Run a job with its progress shown, say what came of it, and return the exit code that tells the same."""
        from stereo_seecolor.cli.progress_bar import progress
        from stereo_seecolor.progress import RunOptions

        with progress(quiet=self.as_json) as listener:
            summary = job(RunOptions(self.workers, self.overwrite, self.strict, listener))
        print(json.dumps(_summary_content(summary, self.out))) if self.as_json else _print_summary(summary, self.out)
        if summary.stopped:
            raise typer.Exit(EXIT_INTERRUPTED)
        return EXIT_DONE if summary.all_done else EXIT_SOME_FAILED


def over_pairs(name: str) -> Callable[[Callable[..., int]], None]:
    """Make a function a command: its parameter ``how`` becomes the options of How, what it returns the exit code."""

    def register(command: Callable[..., int]) -> None:
        own = inspect.signature(command).parameters
        shared = inspect.signature(How).parameters
        options = [p.replace(kind=p.KEYWORD_ONLY) for p in (*own.values(), *shared.values()) if p.name != "how"]

        @wraps(command)
        def with_options(**given: Any) -> None:
            how = How(**{key: given.pop(key) for key in shared})
            raise typer.Exit(command(**given, how=how))

        with_options.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
        with_options.__annotations__ = {p.name: p.annotation for p in options}
        app.command(name)(with_options)

    return register


@app.callback(invoke_without_command=True)
def version_option(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Options before a command."""
    if version:
        from stereo_seecolor.version import __version__

        print(__version__)
        raise typer.Exit


@over_pairs("run")
def run(
    left: Left,
    right: Right,
    calib: Calib,
    how: How,
    water: WaterFile = None,
    poses: Poses = None,
    fuse: Annotated[bool, typer.Option("--fuse", help="Fuse the frames into one map of the dive (OUT/map).")] = False,
) -> int:
    """The whole job: stereo pairs in; range maps, true-color frames and colored clouds out."""
    from stereo_seecolor.commands import jobs

    config = how.settled()
    if poses and not fuse:
        raise typer.BadParameter("--poses places the frames of a map: give --fuse too")
    if fuse:
        jobs.check_fusion(poses, config)
    code = how.go(lambda options: jobs.run(left, right, calib, how.out, config, options, water=water))
    return max(code, _fuse(how.out, poses, config, quiet=how.as_json)) if fuse else code


@over_pairs("correct")
def correct(
    images: Annotated[Path, typer.Option("--images", help="Folder of images.")],
    ranges: Annotated[Path, typer.Option("--range", help="Folder of range maps: float32 TIFF in meters, or 16-bit PNG in mm.")],
    how: How,
    water: WaterFile = None,
) -> int:
    """Color alone: for images that have range maps already."""
    from stereo_seecolor.commands import jobs

    return how.go(lambda options: jobs.correct(images, ranges, how.out, how.settled(), options, water=water))


@over_pairs("range")
def range_(left: Left, right: Right, calib: Calib, how: How) -> int:
    """Range maps alone: stereo pairs in, meters along the ray out."""
    from stereo_seecolor.commands import jobs

    return how.go(lambda options: jobs.run(left, right, calib, how.out, how.settled(), options, ranges_only=True))


@over_pairs("rectify")
def rectify(left: Left, right: Right, calib: Calib, how: How) -> int:
    """Rectified images alone, and the calibration that they have."""
    from stereo_seecolor.commands import jobs

    return how.go(lambda options: jobs.rectify(left, right, calib, how.out, how.settled(), options))


@app.command()
def fuse(
    out: Annotated[Path, typer.Argument(help="The output folder of a finished run.")],
    poses: Poses = None,
    config: ConfigFile = None,
    settings: Settings = None,
) -> None:
    """Fuse a finished run into one map of the dive, OUT/map."""
    raise typer.Exit(_fuse(out, poses, _config(config, settings), quiet=False))


@app.command()
def view(out: Annotated[Path, typer.Argument(help="The output folder of a fused run.")]) -> None:
    """Open the map of a fused run in a window."""
    from stereo_seecolor.mapping.viewer import view as open_map

    open_map(out)


@app.command()
def demo(out: Out = Path("demo"), workers: Workers = DEFAULT_WORKERS) -> None:
    """Make a small reef, run the whole job on it, and say how near the truth it comes."""
    from stereo_seecolor.commands import jobs
    from stereo_seecolor.evaluation.truth import evaluate_truth
    from stereo_seecolor.synthetic.dive import synthesize
    from stereo_seecolor.synthetic.survey import SurveySpec

    print(f"rendering a small dive into {out / 'dive'}")
    dive = out / "dive"
    synthesize(SurveySpec(pairs=4, lines=1), dive)
    config = _config(None, ["color.lock=survey"])
    how = How(out / "out", workers=workers, overwrite=True)
    code = how.go(lambda options: jobs.run(dive / "left", dive / "right", dive / "cam.yaml", how.out, config, options))
    _print_truth(evaluate_truth(out / "out", dive / "truth"))
    raise typer.Exit(code)


@app.command()
def synthesize(
    out: Out = Path("dive"),
    pairs: Annotated[int, typer.Option("--pairs", min=1, help="Stereo pairs in all.")] = 12,
    lines: Annotated[int, typer.Option("--lines", min=1, help="Lines of the lawn mower, flown to and fro.")] = 2,
    size: Annotated[str, typer.Option("--size", help="Image size in pixels, as WIDTHxHEIGHT.")] = "640x512",
    water: Annotated[str, typer.Option("--water", help="blue-ocean, coastal-green or turbid.")] = "blue-ocean",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Another number is another reef and another track.")] = 7,
) -> None:
    """Render a dive over a reef with known truth (docs/synthetic.md)."""
    from stereo_seecolor.synthetic.dive import parse_spec
    from stereo_seecolor.synthetic.dive import synthesize as render

    render(parse_spec(pairs=pairs, lines=lines, size=size, water=water, seed=seed), out)
    print(f"{pairs} pairs in {out}: left/, right/, cam.yaml, trajectory.tum, and the truth in truth/")


@app.command()
def evaluate(
    out: Annotated[Path | None, typer.Argument(help="The output folder of a finished run (with --truth).")] = None,
    truth: Annotated[Path | None, typer.Option("--truth", help="The truth/ folder of a dive made by synthesize.")] = None,
    by_chart: Annotated[bool, typer.Option("--chart", help="Score every method on color charts or white targets.")] = False,
    images: Annotated[Path | None, typer.Option("--images", help="With --chart: folder of images as the camera saw them.")] = None,
    ranges: Annotated[Path | None, typer.Option("--range", help="With --chart: folder of their range maps.")] = None,
    targets: Annotated[
        Path | None,
        typer.Option("--targets", help="With --chart: JSON of chart corners and polygons; without it charts are found."),
    ] = None,
    sheet: Annotated[Path, typer.Option("--sheet", help="With --chart: where the contact sheet goes.")] = Path("charts.png"),
    config: ConfigFile = None,
    settings: Settings = None,
    as_json: AsJson = False,
) -> None:
    """How far a run is from known truth; or, with --chart, how true each method's colors are on targets in the water."""
    if by_chart:
        _evaluate_charts(images, ranges, targets, sheet, _config(config, settings), as_json)
        return
    if out is None or truth is None:
        raise typer.BadParameter("give a run's folder with --truth, or --chart with --images and --range")
    from stereo_seecolor.evaluation.truth import evaluate_truth

    report = evaluate_truth(out, truth)
    print(json.dumps(asdict(report))) if as_json else _print_truth(report)


@app.command()
def calibrate(
    target: Annotated[
        str,
        typer.Option(
            "--target", help="chessboard:9x6:24.23mm (inner corners) or charuco:5X5_100:11x8:30mm:22mm (squares, marker)."
        ),
    ],
    left: Annotated[Path | None, typer.Option("--left", help="Folder of left images of the target.")] = None,
    right: Annotated[Path | None, typer.Option("--right", help="Folder of right images of the target.")] = None,
    out: Annotated[Path, typer.Option("--out", help="Where the calibration goes; its coverage picture goes beside it.")] = Path(
        "cam.yaml"
    ),
    medium: Annotated[
        Literal["water", "air"], typer.Option("--medium", help="Where the images were taken; water is best.")
    ] = "water",
    print_target: Annotated[
        Path | None, typer.Option("--print-target", help="Make the target itself, .pdf or .png, and stop.")
    ] = None,
    dpi: Annotated[int, typer.Option("--dpi", min=10, help="Resolution of a .png target.")] = 300,
    workers: Workers = DEFAULT_WORKERS,
) -> None:
    """Calibrate a rig from image pairs of a chessboard or ChArUco board (docs/calibration.md)."""
    if print_target:
        from calibration.printing import print_target as write_target
        from calibration.targets import parse_target

        write_target(parse_target(target), print_target, dpi)
        print(f"{print_target}: print it at 100 %, glue it flat, and measure it")
        raise typer.Exit
    if left is None or right is None:
        raise typer.BadParameter("give --left and --right, the folders of images (or --print-target)")
    from calibration.formats import write_rig
    from stereo_seecolor.cli.progress_bar import progress
    from stereo_seecolor.commands.calibrating import calibrate_folders
    from stereo_seecolor.files.atomic import write_atomic
    from stereo_seecolor.files.encode import encode_image

    with progress() as listener:
        rig, report = calibrate_folders(left, right, target, medium, workers, listener)
    write_rig(rig, out)
    picture = out.with_name(f"{out.stem}_coverage.png")
    write_atomic(picture, encode_image(report.coverage_picture(), "png"))
    print("\n".join(report.lines()))
    print(f"  {out}: the calibration\n  {picture}: where in the images the corners lay")


@app.command("convert-calib")
def convert_calib(
    source: Annotated[
        str, typer.Argument(help="Any calibration of docs/calibration.md: a file, a folder, or left.yaml,right.yaml.")
    ],
    out: Annotated[str, typer.Argument(help="The file to write; for ros a folder, or left.yaml,right.yaml.")],
    to: Annotated[Literal["native", "ros", "kalibr", "opencv"], typer.Option("--to", help="The format to write.")] = "native",
    size: Annotated[str | None, typer.Option("--size", help="WIDTHxHEIGHT, for a source that does not say (OpenCV).")] = None,
) -> None:
    """Turn a calibration of one format into another; the rays stay the same."""
    from calibration.formats import load_rig, parse_size, write_rig

    write_rig(load_rig(source, parse_size(size) if size else None), out, to)
    print(f"{out}: {to}")


@app.command()
def check(
    left: Left,
    right: Right,
    calib: Calib,
    pairs: Annotated[int, typer.Option("--pairs", min=1, help="How many pairs to look at, spread over the dive.")] = 12,
) -> None:
    """Hold a calibration against the dive's own images; exit code 3 if they disagree."""
    from stereo_seecolor.commands.calibrating import check_folders, describe_rig

    rig, rows, suspicions = check_folders(left, right, calib, pairs)
    print("\n".join([*describe_rig(rig), *(f"suspicious: {text}" for text in suspicions), *rows.lines()]))
    raise typer.Exit(EXIT_DONE if rows.acceptable else EXIT_SOME_FAILED)


@app.command()
def water(
    out: Annotated[Path, typer.Argument(help="The output folder of a finished run with color.lock=survey.")],
    poses: Annotated[Path, typer.Option("--poses", help="Trajectory of the dive (TUM, KITTI, COLMAP, AUV tables).")],
    config: ConfigFile = None,
    settings: Settings = None,
) -> None:
    """Measure the water from places that several frames see; run again with --water to use it."""
    from stereo_seecolor.commands.measured_water import measure_water

    path, found = measure_water(out, poses, _config(config, settings))
    errors = found.standard_errors["y"]
    rates = ", ".join(
        f"{name} {rate:.3f} +- {error:.3f}" for name, rate, error in zip(("red", "green", "blue"), found.y, errors, strict=True)
    )
    print(f"attenuation at long range, 1/m: {rates} (nan: the sightings cannot tell)")
    print(f"use it with: stereo-seecolor run ... --water {path}")


@app.command()
def doctor() -> None:
    """What this machine has, what it lacks, and the command that mends it."""
    from stereo_seecolor.commands.doctor import examine

    findings = examine()
    for finding in findings:
        print(f"{'ok  ' if finding.ok else 'LACK'}  {finding.what}: {finding.detail}")
        if finding.mend:
            print(f"      mend it with: {finding.mend}")
    if any(not finding.ok and finding.needed for finding in findings):
        raise typer.Exit(EXIT_KNOWN_ERROR)


def main() -> None:
    """Run the command line; a known error becomes one line and exit code 1."""
    keep_freed_memory()
    try:
        app()
    except KeyboardInterrupt:
        print("stereo-seecolor: interrupted", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except Exception as error:
        from calibration import CalibrationError
        from stereo_seecolor.errors import SeeColorError

        if not isinstance(error, (SeeColorError, CalibrationError)):
            raise
        print(f"stereo-seecolor: {error}", file=sys.stderr)
        sys.exit(EXIT_KNOWN_ERROR)


def _config(path: Path | None, settings: list[str] | None) -> "RunConfig":
    from stereo_seecolor.config_file import load_config

    return load_config(path, settings or [])


def _fuse(out: Path, poses: Path | None, config: "RunConfig", quiet: bool) -> int:
    from stereo_seecolor.cli.progress_bar import progress
    from stereo_seecolor.commands import jobs

    with progress(quiet) as listener:
        made = jobs.fuse(out, poses, config, listener)
    told = sys.stderr if quiet else sys.stdout
    for frame in made.unplaced:
        print(f"not placed: {frame.name}: {frame.reason}", file=told)
    for warning in made.warnings:
        print(f"warning: {warning}", file=told)
    print(f"{made.placed} of {made.frames} frames fused into {made.points} points, in {made.seconds:.1f} s", file=told)
    for file in made.files:
        print(f"  {file}", file=told)
    return EXIT_SOME_FAILED if made.unplaced else EXIT_DONE


def _evaluate_charts(
    images: Path | None, ranges: Path | None, targets: Path | None, sheet: Path, config: "RunConfig", as_json: bool
) -> None:
    if images is None or ranges is None:
        raise typer.BadParameter("--chart needs --images and --range")
    from rich.console import Console
    from rich.table import Table

    from stereo_seecolor.evaluation.charts import evaluate_charts

    report = evaluate_charts(images, ranges, targets, config, sheet)
    if as_json:
        print(json.dumps({**asdict(report), "sheet": str(sheet), "means": [asdict(row) for row in report.means()]}))
        return
    table = Table("frame", "target", "method", "range m", "psi", "psi linear", "CIEDE2000", "clipped", box=None, header_style="")
    for row in (*report.rows, *report.means()):
        numbers = [f"{value:.1f}" for value in (row.range_m, row.psi_deg, row.psi_linear_deg, row.ciede2000)]
        table.add_row(row.frame, row.target, row.method, *numbers, f"{row.clipped_share:.1%}")
    console = Console(soft_wrap=True, highlight=False)
    console.print(table)
    if report.without_target:
        console.print(f"without a target: {', '.join(report.without_target)}", markup=False)
    console.print(f"  {sheet}: every method on every frame, to look at", markup=False)


def _print_truth(report: "TruthReport") -> None:
    from rich.console import Console
    from rich.table import Table

    ranges, color, raw = report.range, report.color, report.raw_color
    console = Console(soft_wrap=True, highlight=False)
    console.print(f"{len(report.frames)} frames against truth, means over frames; no result for {len(report.missing)} frames")
    console.print(
        f"range: median error {ranges.median_relative_error:.2%} of the range; disparity off by over 1 px {ranges.bad_1_px:.2%}, "
        f"over 2 px {ranges.bad_2_px:.2%}; measured {ranges.coverage:.1%} of the pixels that both cameras see"
    )
    table = Table("color", "corrected", "raw image", box=None, header_style="")
    for what, name, style in (
        ("mean angle to the true color, degrees", "angle_deg", ".2f"),
        ("the same after the best gain a channel", "angle_after_gains_deg", ".2f"),
        ("CIEDE2000, median", "ciede2000", ".2f"),
        ("red/blue far against near, true = 1", "range_consistency", ".3f"),
        ("pixels clipped", "clipped_share", ".2%"),
    ):
        table.add_row(what, format(getattr(color, name), style), format(getattr(raw, name), style))
    console.print(table)
    console.print(
        f"over {color.pixels:.0f} pixels a frame: those with a measured range and a true color neither clipped nor nearly black"
    )


def _summary_content(summary: "RunSummary", out: Path) -> dict[str, Any]:
    return {"out": str(out), **summary.totals(), "failed_pairs": [asdict(row) for row in summary.rows if row.status != "ok"]}


def _print_summary(summary: "RunSummary", out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from stereo_seecolor.run_folder.folder import WHAT_IS_WHERE

    console = Console(soft_wrap=True, highlight=False)
    bad = [row for row in summary.rows if row.status != "ok"]
    for row in bad[:MOST_NAMED]:
        console.print(row.line, markup=False)
    if len(bad) > MOST_NAMED:
        console.print(f"and {len(bad) - MOST_NAMED} more, named in {out / 'frames.csv'}", markup=False)
    for note in summary.notes:
        console.print(f"note: {note}", markup=False)
    problems = summary.problems()
    if problems:
        table = Table("what went wrong", "times", "first in", box=None, header_style="")
        for what, often, first in problems:
            table.add_row(what, str(often), first)
        console.print(table)
    kept = f", {summary.kept} of them kept from an earlier run" if summary.kept else ""
    slowest = next(iter(summary.stage_seconds().items()), None)
    slow = f"; the slowest stage was {slowest[0]} ({slowest[1]:.1f} s of work)" if slowest else ""
    console.print(
        f"{'stopped early: ' if summary.stopped else ''}{summary.count('ok')} pairs done{kept}, {summary.count('failed')} failed, "
        f"{summary.count('unpaired')} files without a partner, in {summary.wall_seconds:.1f} s{slow}",
        markup=False,
    )
    for name, what in WHAT_IS_WHERE.items():
        if (out / name).exists():
            console.print(f"  {out / name}: {what}", markup=False)
