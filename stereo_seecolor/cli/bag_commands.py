"""The command that looks at a ROS bag."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.wording import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.errors import EXIT_DONE, EXIT_SOME_FAILED
from stereo_seecolor.cli.report import LoggedReport

if TYPE_CHECKING:
    from stereo_seecolor.commands.bag_info import BagFacts

BagArgument = Annotated[Path, typer.Argument(metavar="BAG", help="A .bag, .db3 or .mcap file, or a folder with those of one bag.")]


def bag_info(bag: BagArgument, topics: opt.Topics = "", *, report: LoggedReport) -> None:
    """List a ROS bag's topics and the pairs that run would take from it; exit code 3 if it would take none."""
    from stereo_seecolor.commands.bag_info import bag_info as look

    with report.working():
        found = look(bag, topics)
    report.end(vars(found), bag_text(found), EXIT_DONE if found.pairs else EXIT_SOME_FAILED)


def bag_text(found: "BagFacts") -> str:
    """Topics, then the pairs, then the command."""
    width = max(len(topic.name) for topic in found.topics)
    said = [f"{found.bag}: {found.seconds:.1f} s, {len(found.topics)} topics, {found.files} file{'s' * (found.files > 1)}"]
    for topic in found.topics:
        rate = f", {topic.rate_hz:.3g} Hz" if topic.rate_hz else ""
        said.append(f"  {topic.name:<{width}}  {topic.type or 'unknown type'}: {topic.messages} messages{rate}")
    if found.pairs:
        rig = f"baseline {1000 * found.baseline_m:.1f} mm, from camera_info" if found.baseline_m else "no calibration in it"
        said.append(f"{counted(found.pairs, 'pair')}, {counted(found.unpaired, 'image without a partner')}; {rig}")
    said += [f"note: {note}" for note in found.notes]
    if found.pairs:
        calib = "" if found.baseline_m else " --calib cam.yaml"
        said += ["", f"stereo-seecolor run --bag {found.bag}{calib} --out out"]
    return lines(*said)
