"""Commands over the pairs of a dive: run, correct, range, rectify."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import SIDES, command
from stereo_seecolor.cli.report import Report, computing
from stereo_seecolor.cli.result_texts import map_text, page_text, run_text
from stereo_seecolor.cli.results import map_exit_code, run_content, run_exit_code
from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.plugins import load
from stereo_seecolor.run_folder.layout import INDEX

if TYPE_CHECKING:
    from stereo_seecolor.commands.stereo_inputs import DiveInputs
    from stereo_seecolor.dive.run_options import PageTime
    from stereo_seecolor.mapping.survey_map import MapSummary
    from stereo_seecolor.progress import Listener
    from stereo_seecolor.run_folder.frame_table import RunSummary


@command(
    "A dive",
    f"run {SIDES} --out OUT",
    f"run {SIDES} --fuse",
    f"run {SIDES} --refine --fuse --poses nav.tum",
    f"run {SIDES} --water EARLIER/water.json",
    "run --bag dive.mcap --out OUT",
    "run --left a.mp4 --right b.mp4 --calib cam.yaml --out OUT",
)
def run(
    left: opt.OneLeft = None,
    right: opt.OneRight = None,
    calib: opt.OneCalib = None,
    bag: opt.Bag = None,
    out: opt.Out = Path("out"),
    refine: opt.RefineRig = False,
    fuse: Annotated[
        bool, opt.flag("--fuse", "Fuse the frames into one map of the dive, OUT/map.")
    ] = False,
    poses: opt.PosesFile = None,
    water: opt.WaterFile = None,
    out_mcap: opt.OutMcap = None,
    topics: opt.Topics = "",
    *,
    settings: opt.Settings,
    device: opt.Device = None,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    shard: opt.ShardOption = "",
    cluster: opt.ClusterName = "",
    execution: opt.Execution,
    page: opt.LivePage = False,
    report: Report,
) -> None:
    """Compute range maps, true-color images and colored clouds from stereo pairs; optionally also a
    map.
    """
    check_sources(left, right, calib, bag, topics)
    if poses and not fuse:
        raise typer.BadParameter("--poses is used to make a map: give --fuse, too")
    if shard and out_mcap:
        raise typer.BadParameter(
            "--out-mcap records a whole run, not a shard: merge first, then export --to mcap"
        )
    part = _part(shard, fuse)
    with ExitStack() as both_steps:  # the workers stay for the map
        with report.working() as listener:
            compute = both_steps.enter_context(computing(cluster, report.notice))
            from stereo_seecolor.commands.run import run_inputs

            loaded = settings.load(refine, device=device)
            if out_mcap:
                load("recordings", "mcap").check_mcap(out_mcap, execution.overwrite, bag)
            chosen = execution.options(workers, settings.config, listener)
            if fuse:
                # loads what only a map needs
                from stereo_seecolor.commands.fuse import check_fusion
                from stereo_seecolor.commands.fuse import fuse as fuse_frames

                chosen = replace(chosen, also_read=check_fusion(poses, loaded))
            when: PageTime = "live" if page else "none" if fuse else "end"
            options = replace(
                chosen, shard=part, cluster=compute, water=water, page=when, notice=report.notice
            )
            inputs = _inputs(left, right, calib, bag, topics)
            summary = run_inputs(inputs, out, loaded, options)
        if summary.stopped:
            _end(report, summary, out)
        if fuse:
            _end_with_map(
                report,
                summary,
                out,
                lambda listener: fuse_frames(out, poses, loaded, listener, compute),
                out_mcap,
            )
    _end_with_page(report, summary, out, out_mcap)


def _part(shard: str, fuse: bool) -> Shard:
    if shard and fuse:
        raise typer.BadParameter(
            "--shard processes a part of the dive, but --fuse needs all of it: merge "
            "first, then fuse"
        )
    return opt.shard_of(shard)


def check_sources(
    left: str | Path | None,
    right: str | Path | None,
    calib: str | None,
    bag: Path | None,
    topics: str,
) -> None:
    """Raise typer.BadParameter unless a bag, or both sides and their calibration, are given."""
    if bag and (left or right):
        raise typer.BadParameter(
            "--bag contains both sides: give either --bag, or --left and --right"
        )
    if topics and not bag:
        raise typer.BadParameter("--topics names topics of a bag: give --bag, too")
    missing = [
        name
        for name, value in (("--left", left), ("--right", right), ("--calib", calib))
        if not value
    ]
    if missing and not bag:
        raise typer.BadParameter(
            f"{missing[0]} is missing: a dive needs --left, --right and --calib, or --bag"
        )


def _inputs(
    left: Path | None, right: Path | None, calib: str | None, bag: Path | None, topics: str
) -> "DiveInputs":
    from stereo_seecolor.commands.stereo_inputs import StereoInputs

    if bag:
        recorded: DiveInputs = load("inputs", "bag").BagInputs(bag, calib or "", topics)
        return recorded
    assert left and right and calib
    return StereoInputs(left, right, calib)


@command("Single steps of run", "correct --images IMAGES --range RANGES --out OUT")
def correct(
    images: Annotated[Path, opt.option("--images", "FOLDER", "Folder of rectified images.")],
    ranges: Annotated[
        Path,
        opt.option(
            "--range",
            "FOLDER",
            "Folder of range maps with the same names: TIFF, PFM, EXR, NPY, NPZ, MAT; "
            "floating-point numbers are meters, integers millimeters.",
        ),
    ],
    out: opt.Out = Path("out"),
    water: opt.WaterFile = None,
    *,
    settings: opt.Settings,
    device: opt.Device = None,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    execution: opt.Execution,
    report: Report,
) -> None:
    """Correct only colors, of images that already have range maps."""
    from stereo_seecolor.commands.run import correct as correct_images

    with report.working() as listener:
        options = replace(execution.options(workers, settings.config, listener), water=water)
        summary = correct_images(images, ranges, out, settings.load(device=device), options)
    _end_with_page(report, summary, out, None)


@command("Single steps of run", f"range {SIDES} --set matching.max_range_m=8")
def range_(
    left: opt.Left,
    right: opt.Right,
    calib: opt.Calib,
    out: opt.Out = Path("out"),
    refine: opt.RefineRig = False,
    *,
    settings: opt.Settings,
    device: opt.Device = None,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    execution: opt.Execution,
    report: Report,
) -> None:
    """Compute only range maps, in meters along the ray."""
    from stereo_seecolor.commands.run import range_maps

    with report.working() as listener:
        options = replace(
            execution.options(workers, settings.config, listener), notice=report.notice
        )
        summary = range_maps(left, right, calib, out, settings.load(refine, device=device), options)
    _end(report, summary, out)


@command("Single steps of run", f"rectify {SIDES} --out OUT")
def rectify(
    left: opt.Left,
    right: opt.Right,
    calib: opt.Calib,
    out: opt.Out = Path("out"),
    refine: opt.RefineRig = False,
    *,
    settings: opt.Settings,
    workers: opt.Workers = opt.DEFAULT_WORKERS,
    execution: opt.Execution,
    report: Report,
) -> None:
    """Only rectify: write the rectified images and their calibration."""
    from stereo_seecolor.commands.run import rectify as rectify_pairs

    with report.working() as listener:
        options = execution.options(workers, settings.config, listener)
        summary = rectify_pairs(left, right, calib, out, settings.load(refine), options)
    _end(report, summary, out)


def _end(report: Report, summary: "RunSummary", out: Path) -> NoReturn:
    report.end(run_content(summary, out), run_text(summary, out), run_exit_code(summary))


def _end_with_page(
    report: Report, summary: "RunSummary", out: Path, out_mcap: Path | None
) -> NoReturn:
    if summary.stopped:
        _end(report, summary, out)
    report.say(run_text(summary, out))
    with report.working():
        recorded = _record(out, out_mcap)
    page, content = out / INDEX, run_content(summary, out)
    if not page.is_file():  # of a shard
        report.end(content, recorded, run_exit_code(summary))
    report.end({**content, "page": page}, page_text(page) + recorded, run_exit_code(summary))


def _record(out: Path, out_mcap: Path | None) -> str:
    """Write the recording if one was asked for. Returns a line that names it, or ""."""
    if out_mcap is None:
        return ""
    return (
        f"{out_mcap}: {load('recordings', 'mcap').write_mcap(out, out_mcap)} frames as ROS 2 "
        "messages\n"
    )


def _end_with_map(
    report: Report,
    summary: "RunSummary",
    out: Path,
    fuse: "Callable[[Listener], MapSummary]",
    out_mcap: Path | None,
) -> NoReturn:
    from stereo_seecolor.commands.report import report as write_page

    report.say(run_text(summary, out))
    with report.working() as listener:
        made = fuse(listener)
        page = write_page(out, listener).page
        recorded = _record(out, out_mcap)
    content = {**run_content(summary, out), "page": page, "map": made}
    report.end(
        content,
        map_text(made) + page_text(page) + recorded,
        max(run_exit_code(summary), map_exit_code(made)),
    )
