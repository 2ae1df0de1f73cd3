"""Commands on a finished run: fuse, report, view, export."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.wording import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.contents import map_exit_code
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.report import BareReport, Report, computing
from stereo_seecolor.cli.run_text import map_text, measures_text, page_text, report_text

if TYPE_CHECKING:
    from stereo_seecolor.extras.export.command import ExportResult


def fuse(
    out: opt.Finished, poses: opt.PosesFile = None, *, settings: opt.Settings, cluster: opt.ClusterName = "", report: Report
) -> None:
    """Fuse a finished run into one map of the dive, OUT/map: cloud, mesh, orthomosaic, terrain, rugosity."""
    from stereo_seecolor.commands.fuse import fuse as fuse_frames
    from stereo_seecolor.commands.report import report as write_page

    with report.working() as listener, computing(cluster, report.notice) as compute:
        made = fuse_frames(out, poses, settings.load(run=out), listener, compute)
        page = write_page(out, listener, brief=True).page
    text = map_text(made) + page_text(page)
    report.end({"out": out, "page": page, "map": made}, text, map_exit_code(made))


def report(
    out: opt.Finished,
    charts: Annotated[
        bool,
        opt.flag("--charts", "Also search all frames for color charts (seconds a frame), and compare views of the same spots."),
    ] = False,
    *,
    report: Report,
) -> None:
    """Write OUT/index.html, the page of a finished run, with the images and numbers of every frame."""
    from stereo_seecolor.commands.report import report as write_page

    with report.working() as listener:
        result = write_page(out, listener, charts=charts)
    code = EXIT_SOME_FAILED if result.left_out else EXIT_DONE
    report.end({"out": out, **vars(result)}, report_text(result), code)


def measure(
    out: opt.Finished,
    points: Annotated[
        Path, typer.Argument(metavar="POINTS", help="CSV of points as the page saves it: measure, frame, kind, label, x_px, y_px.")
    ],
    lengths: Annotated[bool, opt.flag("--lengths", "Print the lengths as a table with EventMeasure's columns instead.")] = False,
    *,
    report: BareReport,
) -> None:
    """Measure points, lengths and areas in the frames of a run; prints a CSV with standard errors."""
    from stereo_seecolor.extras.reef.commands.length_table import length_table
    from stereo_seecolor.extras.reef.commands.measure import measure as measure_points

    if lengths:
        table = length_table(out, points)
        report.end({"out": out, "table": table}, table)
    results = measure_points(out, points)
    unknown = any(each.value is None for each in results)
    content = {"out": out, "measures": results}
    report.end(content, measures_text(results), EXIT_SOME_FAILED if unknown else EXIT_DONE)


def view(
    out: opt.Finished,
    window: Annotated[bool, opt.flag("--window", "Open the map in a window instead of the page.")] = False,
    *,
    report: BareReport,
) -> None:
    """Open the page of a run in the browser, or its map in a window (--window, or where there is no page)."""
    from stereo_seecolor.commands.view import view as show
    from stereo_seecolor.commands.view import view_map

    result = (view_map if window else show)(out)
    report.end({"out": out, **vars(result)}, "")


def export(
    out: Annotated[Path | None, typer.Argument(metavar="OUT", help="Output folder of a run that was fused.")] = None,
    to: Annotated[str, opt.option("--to", "FORMAT", "Format to write, one of --list.")] = "",
    folder: Annotated[Path | None, opt.option("--out", "FOLDER", "A new or empty output folder.")] = None,
    listed: Annotated[bool, opt.flag("--list", "List the formats, and the programs that open them.")] = False,
    *,
    report: BareReport,
) -> None:
    """Write a fused run for another program: COLMAP, Nerfstudio, Metashape, GLB, TagLab and others."""
    from stereo_seecolor.extras.export.command import export as write
    from stereo_seecolor.extras.export.formats import EXPORT_FORMATS

    if listed:
        report.end(
            {"formats": {name: format.opens for name, format in EXPORT_FORMATS.items()}},
            lines(*(f"{name:<12} {format.what}: {format.opens}" for name, format in EXPORT_FORMATS.items())),
        )
    if out is None or folder is None or not to:
        raise typer.BadParameter("give OUT, --to FORMAT and --out FOLDER, or --list")
    with report.working():
        written = write(out, to, folder)
    report.end({"out": out, **vars(written)}, export_text(written))


def export_text(result: "ExportResult") -> str:
    """The number and size of exported files, and their folder."""
    size = f"{counted(result.frames, 'frame')}, {counted(result.files, 'file')}, {result.bytes / 1e6:.1f} MB"
    return lines(size, *([result.note] if result.note else []), f"  {result.folder}: {result.format}")
