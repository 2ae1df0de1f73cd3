"""The typer application: every command, by name and in the order of the help."""

import contextlib
import sys
from collections.abc import Callable
from typing import Annotated

import typer

from stereo_seecolor.cli import (
    dive_commands,
    inspect_command,
    machine_commands,
    map_commands,
    rig_commands,
    score_commands,
    water_commands,
)
from stereo_seecolor.cli.errors import exit_code_of
from stereo_seecolor.cli.quiet import quiet_libraries
from stereo_seecolor.cli.streams import prepare_streams, write_out
from stereo_seecolor.compute.allocator import keep_freed_memory

COMMANDS: dict[str, Callable[..., None]] = {
    "inspect": inspect_command.inspect,
    "run": dive_commands.run,
    "correct": dive_commands.correct,
    "range": dive_commands.range_,
    "rectify": dive_commands.rectify,
    "fuse": map_commands.fuse,
    "view": map_commands.view,
    "demo": score_commands.demo,
    "synthesize": score_commands.synthesize,
    "evaluate": score_commands.evaluate,
    "calibrate": rig_commands.calibrate,
    "convert-calib": rig_commands.convert_calib,
    "check": rig_commands.check,
    "water": water_commands.water,
    "config": machine_commands.config,
    "doctor": machine_commands.doctor,
}

app = typer.Typer(
    name="stereo-seecolor",
    help="Stereo pairs of a reef in, metric range maps, true-color images and colored 3-D maps out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for name, command in COMMANDS.items():
    app.command(name)(command)


@app.callback(invoke_without_command=True)
def version_option(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
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
