"""Commands over bags, videos and live cameras: live, bag-info, sync."""

import logging
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.errors import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import SIDES, command
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.output import write_error
from stereo_seecolor.cli.report import LoggedReport
from stereo_seecolor.cli.text import lines

if TYPE_CHECKING:
    from stereo_seecolor.extras.streams.bag_info import BagFacts

log = logging.getLogger(__name__)

OneSource = Annotated[
    str | None,
    opt.option(
        "--source",
        "SOURCE",
        "Both sides in one option: a bag, a folder that contains left/ and right/, "
        "LEFT,RIGHT, or a camera that shows both.",
    ),
]
LeftSource = Annotated[
    str | None,
    opt.option(
        "--left",
        "SOURCE",
        "Folder in which left images arrive; a capture device (0), rtsp://... or http://...; or "
        "ros2:/TOPIC.",
    ),
]
RightSource = Annotated[
    str | None,
    opt.option(
        "--right",
        "SOURCE",
        "The same for the right side; the left camera again if it shows both sides.",
    ),
]
Publish = Annotated[
    str,
    opt.option(
        "--publish",
        "NAMESPACE",
        "Publish all pairs as ROS 2 topics in this namespace, for example /seecolor. ROS "
        "need not be installed.",
    ),
]
Played = Annotated[
    Path | None,
    opt.option("--bag", "BAG", "ROS bag instead of two folders, played at its own rate."),
]
KeptIn = Annotated[
    Path | None,
    opt.option(
        "--out",
        "FOLDER",
        "Save all products in this new or empty folder. Default: products are not saved.",
    ),
]
Every = Annotated[
    int, opt.option("--every", "N", "Save only the products of every Nth pair in --out.", min=1)
]
Record = Annotated[
    Path | None,
    opt.option(
        "--record",
        "FILE",
        "Record all pairs to a new MCAP file: images, ranges, points as ROS 2 messages.",
    ),
]
Host = Annotated[
    str,
    opt.option(
        "--host",
        "ADDRESS",
        "Network address of the page. 0.0.0.0: other machines can open it, too, by a URL "
        "with a random token.",
    ),
]
BudgetMs = Annotated[
    float | None,
    opt.option(
        "--budget-ms",
        "MS",
        (
            "Time limit for a pair, in milliseconds. If pairs take longer, they are matched "
            "at half size."
        ),
        min=1,
    ),
]
Cpus = Annotated[int | None, opt.option("--cpus", "N", "Run on at most N processors.", min=1)]
Port = Annotated[
    int | None,
    opt.option(
        "--port",
        "N",
        "Show the last pair on http://127.0.0.1:N; 0 selects a free port.",
        min=0,
        max=65535,
    ),
]
Pairs = Annotated[
    int | None,
    opt.option(
        "--pairs",
        "N",
        "Stop after N pairs; skipped ones do not count. Default: run until Ctrl-C.",
        min=1,
    ),
]


@command("Bags, videos, live", f"live {SIDES} --port 8080", "live --bag dive.mcap --port 8080")
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
    device: opt.Device = None,
    report: LoggedReport,
) -> None:
    """Correct pairs as they arrive from folders, cameras, ROS 2 topics or a bag; the newest pair
    comes first. Exit code 3 if pairs failed, none came, one side sent none at the end, or ranges or
    colors are wrong.
    """
    from stereo_seecolor.cli.dive_commands import check_sources
    from stereo_seecolor.extras.streams.live.command import LiveInputs, LiveOptions
    from stereo_seecolor.extras.streams.live.command import live as correct_live
    from stereo_seecolor.extras.streams.live.sources import source_of

    if source and (left or right or bag):
        raise typer.BadParameter("--source names both sides: omit --left, --right and --bag")
    if source:
        left, right, bag = source_of(source)
    check_sources(left, right, calib, bag, topics)
    if host != "127.0.0.1" and port is None:
        raise typer.BadParameter("--host is the address of the page: give --port, too")

    def announce(line: str) -> None:
        log.info(line)
        write_error(lines(line))

    with report.working():
        budget_s = None if budget_ms is None else budget_ms / 1000
        options = LiveOptions(
            out,
            every,
            record,
            publish,
            port,
            host,
            budget_s,
            cpus,
            pairs,
            announce=announce,
        )
        inputs = LiveInputs(left or "", right or "", bag, topics, calib or "")
        found = correct_live(inputs, settings.load(device=device), options)
    output = [
        f"{counted(found.done, 'pair')} corrected, {found.failed} failed, {found.dropped} "
        "skipped for newer ones"
    ]
    if found.latency_median_s is not None and found.latency_p95_s is not None:
        output.append(
            f"latency: median {found.latency_median_s:.2f} s, 95% below {found.latency_p95_s:.2f} s"
        )
    if found.products_median_s is not None and found.products_p95_s is not None:
        output.append(
            f"all products: median {found.products_median_s:.2f} s, 95% below "
            f"{found.products_p95_s:.2f} s"
        )
    output += [found.reduced] if found.reduced else []
    output += [f"last failure: {found.last_error}"] if found.last_error else []
    if found.waiting:
        alone = ", while images without a partner came" if found.has_unpaired else ""
        output.append(f"at the end it waited for {found.waiting}{alone}")
    is_biased = 2 * found.biased > found.done
    if is_biased:
        output.append(
            f"the ranges of {counted(found.biased, 'pair')} are biased: the calibration does not "
            "fit: run check on some pairs"
        )
    output += [f"note: {note}" for note in found.notes]
    is_wrong = is_biased or found.wrong
    is_missing = found.failed or found.has_unpaired or (found.waiting and not found.done)
    report.end(
        vars(found), lines(*output), EXIT_SOME_FAILED if is_missing or is_wrong else EXIT_DONE
    )


BagArgument = Annotated[
    Path,
    typer.Argument(
        metavar="BAG", help="A .bag, .db3 or .mcap file, or a folder with the files of one bag."
    ),
]


BagRig = Annotated[
    str | None,
    opt.option("--calib", "FILE", "Calibration of the rig, used instead of the bag's camera_info."),
]


LeftVideo = Annotated[Path, typer.Argument(metavar="LEFT", help="Video of the left camera.")]


Rig = Annotated[
    str | None,
    opt.option(
        "--calib",
        "FILE",
        "Calibration of the rig; the offset is then also measured from row differences of "
        "rectified pairs.",
    ),
]


RightVideo = Annotated[Path, typer.Argument(metavar="RIGHT", help="Video of the right camera.")]


@command(
    "Bags, videos, live",
    "bag-info dive.mcap",
    "bag-info BAG --topics left=/fwd/image,right=/aft/image",
)
def bag_info(
    bag: BagArgument, topics: opt.Topics = "", calib: BagRig = None, *, report: LoggedReport
) -> None:
    """List the topics of a ROS bag and the pairs that run would use; exit code 3 if there are no
    pairs.
    """
    from stereo_seecolor.extras.streams.bag_info import bag_info as look

    with report.working():
        found = look(bag, topics, calib=calib or "")
    report.end(
        vars(found),
        bag_text(found, calib or "", topics),
        EXIT_DONE if found.pairs else EXIT_SOME_FAILED,
    )


def bag_text(facts: "BagFacts", calib: str = "", topics: str = "") -> str:
    """The topics of a bag, then its pairs, and last the run command."""
    width = max(len(topic.name) for topic in facts.topics)
    output = [
        f"{facts.bag}: {facts.seconds:.1f} s, {len(facts.topics)} topics, {facts.files} "
        f"file{'s' * (facts.files > 1)}"
    ]
    for topic in facts.topics:
        rate = f", {topic.rate_hz:.3g} Hz" if topic.rate_hz else ""
        output.append(
            f"  {topic.name:<{width}}  {topic.type or 'unknown type'}: "
            f"{counted(topic.messages, 'message')}{rate}"
        )
    if facts.pairs:
        rig = (
            f"baseline {1000 * facts.baseline_m:.1f} mm, from {calib or 'camera_info'}"
            if facts.baseline_m
            else "no calibration for these images in the bag"
        )
        output.append(
            f"{counted(facts.pairs, 'pair')}, "
            f"{counted(facts.unpaired, 'image without a partner')}; {rig}"
        )
    output += [f"note: {note}" for note in facts.notes]
    if facts.pairs:
        named = calib or ("" if facts.baseline_m else "cam.yaml")
        given = ["--topics", topics] if topics else []
        given += ["--calib", named] if named else []
        words = ["stereo-seecolor", "run", "--bag", str(facts.bag), *given, "--out", "out"]
        output += ["", shlex.join(words)]
    return lines(*output)


@command("Bags, videos, live", "sync left.mp4 right.mp4")
def sync(left: LeftVideo, right: RightVideo, calib: Rig = None, *, report: LoggedReport) -> None:
    """Estimate clock offset and drift between two unsynchronized cameras from sound, a flash and
    image motion.
    """
    from stereo_seecolor.extras.streams.videos.sync import sync as find

    with report.working():
        found = find(left, right, calib or "")
    given = ["--left", str(left), "--right", str(right), "--calib", calib or "cam.yaml"]
    output = [found.text]
    output += [
        f"  {item.kind}: {item.offset_s:+.4f} s, standard error {1000 * item.std_s:.1f} ms"
        for item in found.evidence
    ]
    output += [
        counted(found.pairs, "pair of frames"),
        "",
        shlex.join(["stereo-seecolor", "run", *given, "--out", "out"]),
    ]
    report.end(vars(found), lines(*output))
