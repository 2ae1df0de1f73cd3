"""Options that several commands share, each declared once: its type, its name and its help text;
and groups of them.

Options without a panel come first in the help of a command, since everybody needs them. The panels
contain the other options.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from stereo_seecolor.compute.shard import Shard
from stereo_seecolor.compute.threads import cores

if TYPE_CHECKING:
    from stereo_seecolor.config import RunConfig
    from stereo_seecolor.dive.run_options import RunOptions
    from stereo_seecolor.progress import Listener

DEFAULT_WORKERS = min(cores() + 1, 8)
"""One more than cores, which work on while a pair waits for the disk."""

COLOR, SETTINGS, EXECUTION, REPORTING = "Color and map", "Settings", "Execution", "Reporting"


def option(
    name: str, metavar: str | None, help: str, panel: str | None = None, **limits: Any
) -> Any:
    """An option with a value. metavar: None for a choice of words. limits: of a number."""
    return typer.Option(name, metavar=metavar, help=help, rich_help_panel=panel, **limits)


def flag(name: str, help: str, panel: str | None = None) -> Any:
    """An option that takes no value."""
    return option(name, "", help, panel)


_LEFT = option(
    "--left",
    "FOLDER",
    "Folder of left images, a quoted pattern ('DIVE/*_L.png', 'DIVE/*/left'), or a video.",
)
_RIGHT = option(
    "--right",
    "FOLDER",
    "The same for the right side. If each image shows both sides, give the left folder or video "
    "again.",
)
_CALIB = option(
    "--calib", "FILE", "Calibration of the rig: cam.yaml, or any format of docs/calibration.md."
)
Left = Annotated[Path, _LEFT]
Right = Annotated[Path, _RIGHT]
Calib = Annotated[str, _CALIB]
OneLeft = Annotated[Path | None, _LEFT]
OneRight = Annotated[Path | None, _RIGHT]
OneCalib = Annotated[str | None, _CALIB]
Bag = Annotated[
    Path | None,
    option(
        "--bag",
        "BAG",
        "ROS bag instead of two folders: .bag, .db3, .mcap, or the folder of a split bag. A "
        "calibration is then optional: the default is the camera_info of the bag.",
    ),
]
Topics = Annotated[
    str,
    option(
        "--topics",
        "LIST",
        "Image topics of the bag, if they are not recognized: left=NAME,right=NAME.",
        SETTINGS,
    ),
]
Out = Annotated[
    Path,
    option(
        "--out", "FOLDER", "Output folder. Run again with the same folder to resume a stopped run."
    ),
]
OutMcap = Annotated[
    Path | None,
    option(
        "--out-mcap",
        "FILE",
        "Also record the finished frames as ROS 2 messages in an MCAP file.",
        EXECUTION,
    ),
]
Finished = Annotated[Path, typer.Argument(metavar="OUT", help="Output folder of a finished run.")]
RefineRig = Annotated[
    bool,
    flag(
        "--refine",
        "First refine the calibration on pairs of the dive, in case the rig has moved "
        "(input.refine).",
    ),
]
WaterFile = Annotated[
    Path | None,
    option(
        "--water", "FILE", "water.json of an earlier run, used instead of fitting the water.", COLOR
    ),
]
PosesFile = Annotated[
    Path | None,
    option(
        "--poses",
        "FILE",
        "Trajectory of the dive: TUM, KITTI, COLMAP, AUV tables, or a ROS bag.",
        COLOR,
    ),
]
LivePage = Annotated[
    bool,
    flag(
        "--page",
        ("Update OUT/index.html during the run; the page in an open browser reloads itself."),
        REPORTING,
    ),
]
Device = Annotated[
    Literal["auto", "cpu", "cuda"] | None,
    option(
        "--device",
        None,
        ("Device for matching and correction; auto uses a GPU if there is one (docs/gpu.md)."),
        EXECUTION,
    ),
]
Workers = Annotated[
    int, option("--workers", "N", "Number of pairs processed at the same time.", EXECUTION, min=1)
]
ClusterName = Annotated[
    str,
    option(
        "--cluster",
        "WHERE",
        "Run on a cluster: local:N, tcp://HOST:PORT, or slurm:cluster.yaml (docs/fleets.md).",
        EXECUTION,
    ),
]
ShardOption = Annotated[
    str,
    option(
        "--shard",
        "I/N",
        "Process only part I of N of the pairs, into a separate output folder; merge "
        "joins the parts (docs/fleets.md).",
        EXECUTION,
    ),
]
Overwrite = Annotated[
    bool,
    flag(
        "--overwrite",
        "Remove the results that an earlier run wrote into the output folder.",
        EXECUTION,
    ),
]
AsJson = Annotated[
    bool, flag("--json", "Print the result as one JSON object (docs/json.md).", REPORTING)
]


@dataclass(frozen=True)
class Settings:
    """Options for settings: a file, and single values."""

    config: Annotated[
        Path | None,
        option("--config", "FILE", "YAML file of settings (docs/configuration.md).", SETTINGS),
    ] = None
    settings: Annotated[
        list[str] | None,
        option(
            "--set",
            "KEY=VALUE",
            "One setting, written section.key=value. May be repeated.",
            SETTINGS,
        ),
    ] = None

    def load(
        self, refine: bool = False, run: Path | None = None, device: str | None = None
    ) -> "RunConfig":
        """The configuration. refine: --refine was given. run: an output folder whose settings are
        used if no file is named.

        device: --device, None where it was not given.
        """
        from stereo_seecolor.config.file import load_config

        file = self.config
        if run and not file:
            from stereo_seecolor.run_folder.finished_run import settings_file

            file = settings_file(run)
        chosen = [f"device={device}"] if device else []
        return load_config(
            file, [*(self.settings or []), *(["input.refine=true"] if refine else []), *chosen]
        )


@dataclass(frozen=True)
class Execution:
    """Options for the execution of a command over pairs."""

    overwrite: Overwrite = False
    strict: Annotated[bool, flag("--strict", "Stop at the first pair that fails.", EXECUTION)] = (
        False
    )
    verify: Annotated[
        bool,
        flag(
            "--verify",
            "Read every input again, even if its size and time have not changed.",
            EXECUTION,
        ),
    ] = False

    def options(self, workers: int, config_file: Path | None, listener: "Listener") -> "RunOptions":
        """The options as the function of the command takes them."""
        from stereo_seecolor.dive.run_options import RunOptions

        return RunOptions(
            workers,
            self.overwrite,
            self.strict,
            self.verify,
            config_file,
            tuple(sys.argv),
            listener,
        )


def shard_of(text: str) -> Shard:
    """The shard of --shard; all pairs for "". Raises typer.BadParameter."""
    try:
        return Shard.parse(text) if text else Shard()
    except ValueError as error:
        raise typer.BadParameter(f"--shard: {error}") from error
