"""Options that several commands share, each declared once: its type, its name and its help text.

Options without a panel come first in the help of a command: those that everybody needs. The panels hold the rest.
"""

from pathlib import Path
from typing import Annotated, Literal

import typer

from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.compute.threads import cores

ProgressKind = Literal["auto", "bar", "lines", "json", "none"]
DEFAULT_WORKERS = min(cores(), 8)

COLOR, SETTINGS, EXECUTION, REPORTING = "Color and map", "Settings", "Execution", "Reporting"

Left = Annotated[
    Path, typer.Option("--left", metavar="FOLDER", help="Folder of left images, a quoted pattern ('DIVE/*_L.png'), or a video.")
]
Right = Annotated[
    Path,
    typer.Option("--right", metavar="FOLDER", help="The same of the right side; the left video again if it shows both."),
]
Calib = Annotated[
    str, typer.Option("--calib", metavar="FILE", help="Calibration of the rig: cam.yaml, or any format of docs/calibration.md.")
]
OneLeft = Annotated[
    Path | None,
    typer.Option("--left", metavar="FOLDER", help="Folder of left images, a quoted pattern ('DIVE/*_L.png'), or a video."),
]
OneRight = Annotated[
    Path | None,
    typer.Option("--right", metavar="FOLDER", help="The same of the right side; the left video again if it shows both."),
]
OneCalib = Annotated[
    str | None,
    typer.Option("--calib", metavar="FILE", help="Calibration of the rig: cam.yaml, or any format of docs/calibration.md."),
]
Bag = Annotated[
    Path | None,
    typer.Option(
        "--bag",
        metavar="BAG",
        help="ROS bag instead of two folders: .bag, .db3, .mcap, or a folder of a split one. Without a calibration its own "
        "camera_info is used.",
    ),
]
Topics = Annotated[
    str,
    typer.Option(
        "--topics",
        metavar="LIST",
        help="Image topics of the bag, where they are not found: left=NAME,right=NAME.",
        rich_help_panel=SETTINGS,
    ),
]
Out = Annotated[
    Path, typer.Option("--out", metavar="FOLDER", help="Output folder. Run again with the same folder to resume a stopped run.")
]
OutMcap = Annotated[
    Path | None,
    typer.Option(
        "--out-mcap",
        metavar="FILE",
        help="Record the finished frames as ROS 2 messages in an MCAP file too.",
        rich_help_panel=EXECUTION,
    ),
]
Finished = Annotated[Path, typer.Argument(metavar="OUT", help="Output folder of a finished run.")]
RefineRig = Annotated[
    bool,
    typer.Option(
        "--refine",
        metavar="",
        help="First estimate what has moved in the rig since its calibration, from pairs of the dive (input.refine).",
    ),
]
WaterFile = Annotated[
    Path | None,
    typer.Option(
        "--water", metavar="FILE", help="water.json of an earlier run, used instead of fitting the water.", rich_help_panel=COLOR
    ),
]
PosesFile = Annotated[
    Path | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="Trajectory of the dive: TUM, KITTI, COLMAP, AUV tables, or a ROS bag.",
        rich_help_panel=COLOR,
    ),
]
LivePage = Annotated[
    bool,
    typer.Option(
        "--page",
        metavar="",
        help="Write OUT/index.html already while the run works; a browser that shows it renews it by itself.",
        rich_help_panel=REPORTING,
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", metavar="FILE", help="YAML file of settings (docs/configuration.md).", rich_help_panel=SETTINGS),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="One setting, written section.key=value. May be repeated.", rich_help_panel=SETTINGS
    ),
]
Workers = Annotated[
    int,
    typer.Option("--workers", metavar="N", min=1, help="Number of pairs processed at the same time.", rich_help_panel=EXECUTION),
]
ClusterName = Annotated[
    str,
    typer.Option(
        "--cluster",
        metavar="WHERE",
        help="Work on a cluster: local:N, tcp://HOST:PORT, or slurm:cluster.yaml (docs/fleets.md).",
        rich_help_panel=EXECUTION,
    ),
]
ShardOption = Annotated[
    str,
    typer.Option(
        "--shard",
        metavar="I/N",
        help="Do only part I of N of the pairs, into an output folder of its own; merge joins them (docs/fleets.md).",
        rich_help_panel=EXECUTION,
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        metavar="",
        help="Remove the results that an earlier run wrote into the output folder.",
        rich_help_panel=EXECUTION,
    ),
]
Verify = Annotated[
    bool,
    typer.Option(
        "--verify",
        metavar="",
        help="Read every input again, also those whose size and time have not changed.",
        rich_help_panel=EXECUTION,
    ),
]
Strict = Annotated[bool, typer.Option("--strict", metavar="", help="Stop at the first pair that fails.", rich_help_panel=EXECUTION)]
AsJson = Annotated[
    bool, typer.Option("--json", metavar="", help="Print the result as one JSON object (docs/json.md).", rich_help_panel=REPORTING)
]
Progress = Annotated[
    ProgressKind,
    typer.Option(
        "--progress",
        help="Progress on standard error. auto: a bar on a terminal, elsewhere JSON lines with --json and plain lines without.",
        rich_help_panel=REPORTING,
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", metavar="", help="Write the log to standard error, debugging messages included.", rich_help_panel=REPORTING
    ),
]
LogFile = Annotated[
    Path | None, typer.Option("--log-file", metavar="FILE", help="Append the log to this file.", rich_help_panel=REPORTING)
]


def shard_of(text: str) -> Shard:
    """The shard of a command line; all pairs where it names none."""
    try:
        return Shard.parse(text) if text else Shard()
    except ValueError as error:
        raise typer.BadParameter(f"--shard: {error}") from error


def with_refine(settings: list[str] | None, refine: bool) -> list[str]:
    """The settings of a command line with ``--refine``."""
    return [*(settings or []), *(["input.refine=true"] if refine else [])]
