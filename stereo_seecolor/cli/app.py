"""The typer application: every command, by name and in the order of the help."""

import contextlib
import sys
from collections.abc import Callable
from typing import Annotated

import typer

from stereo_seecolor.cli import (
    dive_commands,
    fleet_commands,
    live_command,
    look_commands,
    machine_commands,
    map_commands,
    reef_commands,
    rig_commands,
    score_commands,
    water_commands,
)
from stereo_seecolor.cli.errors import exit_code_of
from stereo_seecolor.cli.examples import epilog
from stereo_seecolor.cli.grouped import one_by_one
from stereo_seecolor.cli.quiet import quiet_libraries
from stereo_seecolor.cli.streams import prepare_streams, write_out
from stereo_seecolor.compute.allocator import keep_freed_memory

COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "A dive": {
        "inspect": look_commands.inspect,
        "bag-info": look_commands.bag_info,
        "sync": look_commands.sync,
        "live": live_command.live,
        "run": dive_commands.run,
        "fuse": map_commands.fuse,
        "report": map_commands.report,
        "view": map_commands.view,
        "measure": map_commands.measure,
        "metrics": reef_commands.metrics,
        "compare": reef_commands.compare,
        "markers": reef_commands.markers,
        "export": map_commands.export,
    },
    "Single steps of run": {
        "rectify": dive_commands.rectify,
        "range": dive_commands.range_,
        "correct": dive_commands.correct,
        "water": water_commands.water,
    },
    "Calibration": {
        "calibrate": rig_commands.calibrate,
        "check": rig_commands.check,
        "convert-calib": rig_commands.convert_calib,
    },
    "Accuracy": {"demo": score_commands.demo, "evaluate": score_commands.evaluate, "synthesize": score_commands.synthesize},
    "Many machines, many dives": {
        "campaign": fleet_commands.campaign,
        "plan": fleet_commands.plan,
        "merge": fleet_commands.merge,
        "status": fleet_commands.status,
    },
    "This program": {"config": machine_commands.config, "doctor": machine_commands.doctor},
}
"""Panel of the help -> command -> function."""

app = typer.Typer(
    name="stereo-seecolor",
    help="Stereo pairs of a reef in, metric range maps, true-color images and colored 3-D maps out.",
    epilog="Begin with: stereo-seecolor demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for panel, commands in COMMANDS.items():
    for name, command in commands.items():
        app.command(name, epilog=epilog(name), rich_help_panel=panel)(one_by_one(name, command))


@app.callback(invoke_without_command=True)
def version_option(
    version: Annotated[bool, typer.Option("--version", metavar="", help="Print the version and exit.")] = False,
) -> None:
    """Options before a command."""
    if version:
        from stereo_seecolor.version import __version__

        write_out(f"{__version__}\n")
        raise typer.Exit


def run_command_line() -> int:
    """Run the command that the program was started with and return its exit code."""
    prepare_streams()
    keep_freed_memory()
    words = sys.argv[1:]
    with contextlib.nullcontext() if "--verbose" in words else quiet_libraries():
        return exit_code_of(lambda: app(standalone_mode=False, prog_name="stereo-seecolor"), as_json="--json" in words)
