"""The command that corrects pairs as they arrive."""

from pathlib import Path
from typing import Annotated

import typer

from calibration.wording import counted
from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.options import AsJson, ConfigFile, LogFile, OneCalib, Settings, Topics, Verbose
from stereo_seecolor.cli.report import Report
from stereo_seecolor.cli.streams import write_error

OneSource = Annotated[
    str | None,
    typer.Option(
        "--source",
        metavar="SOURCE",
        help="Both sides in one option: a bag, a folder with left/ and right/ in it, LEFT,RIGHT, or a camera that shows both.",
    ),
]
LeftSource = Annotated[
    str | None,
    typer.Option(
        "--left",
        metavar="SOURCE",
        help="Folder that left images arrive in; a capture device (0), rtsp://... or http://...; or ros2:/TOPIC.",
    ),
]
RightSource = Annotated[
    str | None,
    typer.Option("--right", metavar="SOURCE", help="The same of the right side; the left camera again if it shows both."),
]
Publish = Annotated[
    str, typer.Option("--publish", metavar="NAMESPACE", help="Publish all pairs as ROS 2 topics there, without ROS (/seecolor).")
]
Played = Annotated[
    Path | None, typer.Option("--bag", metavar="BAG", help="ROS bag instead of two folders, played at its own rate.")
]
KeptIn = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Keep all products there, in a new or empty folder. Default: none are kept."),
]
Every = Annotated[int, typer.Option("--every", metavar="N", min=1, help="Of the pairs, keep the products of every Nth in --out.")]
Record = Annotated[
    Path | None,
    typer.Option("--record", metavar="FILE", help="Record all pairs to a new MCAP file: images, ranges, points as ROS 2 messages."),
]
Host = Annotated[
    str,
    typer.Option("--host", metavar="ADDRESS", help="Show the page to other machines too; its address then ends in a random token."),
]
BudgetMs = Annotated[
    float | None,
    typer.Option("--budget-ms", metavar="MS", min=1, help="What a pair may take; where it takes longer, half the size is matched."),
]
Cpus = Annotated[int | None, typer.Option("--cpus", metavar="N", min=1, help="Run on at most so many processors.")]
Port = Annotated[
    int | None,
    typer.Option("--port", metavar="N", min=0, max=65535, help="Show the last pair on http://127.0.0.1:N; 0 takes a free port."),
]
Pairs = Annotated[int | None, typer.Option("--pairs", metavar="N", min=1, help="End after so many pairs. Default: at Ctrl-C.")]


def live(
    source: OneSource = None,
    left: LeftSource = None,
    right: RightSource = None,
    calib: OneCalib = None,
    bag: Played = None,
    topics: Topics = "",
    port: Port = None,
    host: Host = "127.0.0.1",
    out: KeptIn = None,
    every: Every = 1,
    record: Record = None,
    publish: Publish = "",
    budget_ms: BudgetMs = None,
    cpus: Cpus = None,
    pairs: Pairs = None,
    config: ConfigFile = None,
    settings: Settings = None,
    as_json: AsJson = False,
    verbose: Verbose = False,
    log_file: LogFile = None,
) -> None:
    """Correct pairs as they arrive in two folders, from cameras, topics or a played bag; the newest wins."""
    from stereo_seecolor.cli.dive_commands import check_sources
    from stereo_seecolor.commands.live import LiveInputs, LiveOptions
    from stereo_seecolor.commands.live import live as correct_live
    from stereo_seecolor.config_file import load_config
    from stereo_seecolor.live.sources import source_of

    if source and (left or right or bag):
        raise typer.BadParameter("--source names both sides: leave --left, --right and --bag out")
    if source:
        left, right, bag = source_of(source)
    check_sources(left, right, calib, bag, topics)
    if host != "127.0.0.1" and port is None:
        raise typer.BadParameter("--host says where the page is shown: give --port too")
    report = Report("live", as_json, "none", verbose, log_file)
    with report.working():
        budget_s = None if budget_ms is None else budget_ms / 1000
        options = LiveOptions(
            out, every, record, publish, port, host, budget_s, cpus, pairs, announce=lambda address: write_error(f"{address}\n")
        )
        inputs = LiveInputs(left or "", right or "", bag, topics, calib or "")
        found = correct_live(inputs, load_config(config, settings or []), options)
    said = [f"{counted(found.done, 'pair')} corrected, {found.failed} failed, {found.dropped} passed over for newer ones"]
    if found.latency_median_s is not None and found.latency_p95_s is not None:
        said.append(f"latency: median {found.latency_median_s:.2f} s, 95% below {found.latency_p95_s:.2f} s")
    if found.products_median_s is not None and found.products_p95_s is not None:
        said.append(f"all products: median {found.products_median_s:.2f} s, 95% below {found.products_p95_s:.2f} s")
    said += [found.reduced] if found.reduced else []
    said += [f"last failure: {found.last_error}"] if found.last_error else []
    report.end(dict(vars(found)), lines(said))
