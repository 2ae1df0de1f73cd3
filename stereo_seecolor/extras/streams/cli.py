"""The command live, which corrects pairs as they arrive."""

from pathlib import Path
from typing import Annotated

import typer

from calibration.wording import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.report import LoggedReport
from stereo_seecolor.cli.streams import write_error

OneSource = Annotated[
    str | None,
    opt.option(
        "--source",
        "SOURCE",
        "Both sides in one option: a bag, a folder with left/ and right/ in it, LEFT,RIGHT, or a camera that shows both.",
    ),
]
LeftSource = Annotated[
    str | None,
    opt.option(
        "--left", "SOURCE", "Folder in which left images arrive; a capture device (0), rtsp://... or http://...; or ros2:/TOPIC."
    ),
]
RightSource = Annotated[
    str | None, opt.option("--right", "SOURCE", "The same for the right side; the left camera again if it shows both.")
]
Publish = Annotated[
    str,
    opt.option(
        "--publish",
        "NAMESPACE",
        "Publish all pairs as ROS 2 topics in this namespace, such as /seecolor. ROS need not be installed.",
    ),
]
Played = Annotated[Path | None, opt.option("--bag", "BAG", "ROS bag instead of two folders, played at its own rate.")]
KeptIn = Annotated[
    Path | None, opt.option("--out", "FOLDER", "Keep all products in this new or empty folder. Default: none are kept.")
]
Every = Annotated[int, opt.option("--every", "N", "Keep the products of every Nth pair only, in --out.", min=1)]
Record = Annotated[
    Path | None, opt.option("--record", "FILE", "Record all pairs to a new MCAP file: images, ranges, points as ROS 2 messages.")
]
Host = Annotated[
    str,
    opt.option(
        "--host",
        "ADDRESS",
        "Address that the page is served on. 0.0.0.0: other machines can open it too, by a URL with a random token.",
    ),
]
BudgetMs = Annotated[
    float | None,
    opt.option(
        "--budget-ms", "MS", "Time for a pair, in milliseconds. Where pairs take longer, they are matched at half size.", min=1
    ),
]
Cpus = Annotated[int | None, opt.option("--cpus", "N", "Run on at most N processors.", min=1)]
Port = Annotated[
    int | None, opt.option("--port", "N", "Show the last pair on http://127.0.0.1:N; 0 takes a free port.", min=0, max=65535)
]
Pairs = Annotated[int | None, opt.option("--pairs", "N", "Stop after N pairs. Default: at Ctrl-C.", min=1)]


def live(
    source: OneSource = None,
    left: LeftSource = None,
    right: RightSource = None,
    calib: opt.OneCalib = None,
    bag: Played = None,
    topics: opt.Topics = "",
    port: Port = None,
    host: Host = "127.0.0.1",
    out: KeptIn = None,
    every: Every = 1,
    record: Record = None,
    publish: Publish = "",
    budget_ms: BudgetMs = None,
    cpus: Cpus = None,
    pairs: Pairs = None,
    *,
    settings: opt.Settings,
    report: LoggedReport,
) -> None:
    """Correct pairs as they arrive, from folders, cameras, ROS 2 topics or a played bag; always the newest pair."""
    from stereo_seecolor.cli.dive_commands import check_sources
    from stereo_seecolor.extras.streams.live.command import LiveInputs, LiveOptions
    from stereo_seecolor.extras.streams.live.command import live as correct_live
    from stereo_seecolor.extras.streams.live.sources import source_of

    if source and (left or right or bag):
        raise typer.BadParameter("--source names both sides: leave --left, --right and --bag out")
    if source:
        left, right, bag = source_of(source)
    check_sources(left, right, calib, bag, topics)
    if host != "127.0.0.1" and port is None:
        raise typer.BadParameter("--host says where the page is shown: give --port too")
    with report.working():
        budget_s = None if budget_ms is None else budget_ms / 1000
        options = LiveOptions(
            out, every, record, publish, port, host, budget_s, cpus, pairs, announce=lambda address: write_error(f"{address}\n")
        )
        inputs = LiveInputs(left or "", right or "", bag, topics, calib or "")
        found = correct_live(inputs, settings.load(), options)
    output = [f"{counted(found.done, 'pair')} corrected, {found.failed} failed, {found.dropped} passed over for newer ones"]
    if found.latency_median_s is not None and found.latency_p95_s is not None:
        output.append(f"latency: median {found.latency_median_s:.2f} s, 95% below {found.latency_p95_s:.2f} s")
    if found.products_median_s is not None and found.products_p95_s is not None:
        output.append(f"all products: median {found.products_median_s:.2f} s, 95% below {found.products_p95_s:.2f} s")
    output += [found.reduced] if found.reduced else []
    output += [f"last failure: {found.last_error}"] if found.last_error else []
    report.end(vars(found), lines(*output))
