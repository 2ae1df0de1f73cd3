"""The command that synchronizes two videos."""

from pathlib import Path
from typing import Annotated

import typer

from calibration.wording import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.console import lines
from stereo_seecolor.cli.report import LoggedReport

LeftVideo = Annotated[Path, typer.Argument(metavar="LEFT", help="Video of the left camera.")]
Rig = Annotated[
    str | None, opt.option("--calib", "FILE", "Calibration of the rig: rows of rectified pairs then tell the offset too.")
]
RightVideo = Annotated[Path, typer.Argument(metavar="RIGHT", help="Video of the right camera.")]


def sync(left: LeftVideo, right: RightVideo, calib: Rig = None, *, report: LoggedReport) -> None:
    """Find offset and drift of two cameras without a wire, from sound, a flash and the motion of the picture."""
    from stereo_seecolor.commands.sync import sync as find

    with report.working():
        found = find(left, right, calib or "")
    said = [found.text]
    said += [f"  {item.kind}: {item.offset_s:+.4f} s, standard error {1000 * item.std_s:.1f} ms" for item in found.evidence]
    said += [
        counted(found.pairs, "pair of frames"),
        "",
        f"stereo-seecolor run --left {left} --right {right} --calib cam.yaml --out out",
    ]
    report.end(vars(found), lines(*said))
