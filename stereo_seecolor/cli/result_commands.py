"""Commands on a finished run: fuse, report, view."""

from typing import Annotated

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.report import BareReport, Report, computing
from stereo_seecolor.cli.result_texts import map_text, page_text, report_text
from stereo_seecolor.cli.results import map_exit_code


@command("A dive", "fuse OUT", "fuse OUT --poses nav.tum --set mapping.voxel_m=0.005")
def fuse(
    out: opt.Finished,
    poses: opt.PosesFile = None,
    *,
    settings: opt.Settings,
    cluster: opt.ClusterName = "",
    report: Report,
) -> None:
    """Fuse a finished run into one map of the dive, OUT/map: cloud, mesh, orthomosaic, terrain,
    rugosity.
    """
    from stereo_seecolor.commands.fuse import fuse as fuse_frames
    from stereo_seecolor.commands.report import report as write_page

    with report.working() as listener, computing(cluster, report.notice) as compute:
        made = fuse_frames(out, poses, settings.load(run=out), listener, compute)
        page = write_page(out, listener).page
    text = map_text(made) + page_text(page)
    report.end({"out": out, "page": page, "map": made}, text, map_exit_code(made), [out])


@command("A dive", "report OUT")
def report(
    out: opt.Finished,
    charts: Annotated[
        bool,
        opt.flag(
            "--charts",
            "Also search all frames for color charts (seconds per frame), and compare "
            "views of the same spots.",
        ),
    ] = False,
    *,
    report: Report,
) -> None:
    """Write OUT/index.html, the page of a finished run, with the images and numbers of every
    frame.
    """
    from stereo_seecolor.commands.report import report as write_page

    with report.working() as listener:
        result = write_page(out, listener, charts=charts)
    code = EXIT_SOME_FAILED if result.left_out else EXIT_DONE
    report.end({"out": out, **vars(result)}, report_text(result), code)


@command("A dive", "view OUT", "view OUT --window")
def view(
    out: opt.Finished,
    window: Annotated[
        bool, opt.flag("--window", "Open the map in a window instead of the page.")
    ] = False,
    *,
    report: BareReport,
) -> None:
    """Open the page of a run in the browser, or its map in a window (with --window, or if there is
    no page).
    """
    from stereo_seecolor.commands.view import view as show
    from stereo_seecolor.commands.view import view_map

    result = (view_map if window else show)(out)
    report.end({"out": out, **vars(result)}, "")
