"""The command line as a typer application: every command, by name and in the order of the help."""

import contextlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from stereo_seecolor.cli import (
    dive_commands,
    look_commands,
    machine_commands,
    result_commands,
    rig_commands,
)
from stereo_seecolor.cli.command import Command
from stereo_seecolor.cli.errors import exit_code_of
from stereo_seecolor.cli.output import prepare_streams, write_error, write_out
from stereo_seecolor.cli.quiet import quiet_libraries
from stereo_seecolor.cli.report import Report
from stereo_seecolor.compute.process import tune_malloc
from stereo_seecolor.errors import PluginError
from stereo_seecolor.plugins import added, load

CORE: dict[str, Command] = {
    "run": dive_commands.run,
    "inspect": look_commands.inspect,
    "check": rig_commands.check,
    "fuse": result_commands.fuse,
    "report": result_commands.report,
    "view": result_commands.view,
    "calibrate": rig_commands.calibrate,
    "convert-calib": rig_commands.convert_calib,
    "rectify": dive_commands.rectify,
    "range": dive_commands.range_,
    "correct": dive_commands.correct,
    "doctor": machine_commands.doctor,
    "config": machine_commands.config,
}
"""The commands of the core, in the order of the help."""


def every_command() -> dict[str, Command]:
    """The core's commands, then the packages'; one that cannot be loaded is named on stderr."""
    commands = dict(CORE)
    for name in added("commands"):
        try:
            commands.setdefault(name, load("commands", name, Command))
        except PluginError as error:
            write_error(f"{error}\n")
    return commands


def _needed(words: Sequence[str]) -> dict[str, Command]:
    """The commands that a command line may mean: the one that its first word names, else all."""
    named = next((word for word in words if not word.startswith("-")), "")
    if named in CORE:
        return {named: CORE[named]}
    return (
        {named: load("commands", named, Command)} if named in added("commands") else every_command()
    )


class _PlainFlags:
    """A command whose flags show no placeholder for a value in the help."""

    def get_params(self, ctx: Any) -> Any:
        params = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            if getattr(param, "is_flag", False) and param.metavar is None:
                param.metavar = ""
        return params


class _Command(_PlainFlags, TyperCommand):
    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse a value that is given twice: the first folder of two would be left out unsaid."""
        given = [word.partition("=")[0] for word in args]
        for param in self.get_params(ctx):
            names = [name for name in param.opts if name.startswith("--")]
            if sum(map(given.count, names)) > 1 and not (
                getattr(param, "multiple", False) or getattr(param, "is_flag", False)
            ):
                raise typer.BadParameter(f"{names[0]} is given twice: give it once", ctx)
        return list(super().parse_args(ctx, args))


class _Group(_PlainFlags, TyperGroup):
    pass


def program(commands: Mapping[str, Command]) -> typer.Typer:
    """The command line with these commands."""
    app = typer.Typer(
        cls=_Group,
        context_settings={"help_option_names": ["-h", "--help"]},
        name="stereo-seecolor",
        help="Turns calibrated stereo pairs of a reef into metric range maps, true-color images "
        "and a colored 3-D map.",
        epilog="Begin with: stereo-seecolor demo\n\nOptions and examples of a command: "
        "stereo-seecolor COMMAND --help",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )
    app.callback(invoke_without_command=True)(version_option)
    for name, command in commands.items():
        options = one_by_one(name, command.function)
        app.command(
            name,
            cls=_Command,
            help=_unwrapped(command.function.__doc__ or ""),
            epilog=_examples(command),
            rich_help_panel=command.panel,
        )(options)
    return app


def _unwrapped(text: str) -> str:
    """Paragraphs without the line breaks of the source, for the terminal to break by its width."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _examples(command: Command) -> str:
    """The examples of a command as paragraphs, each of which typer prints on a line of its own."""
    return (
        "\n\n".join(["Examples:", *(f"  stereo-seecolor {words}" for words in command.examples)])
        if command.examples
        else ""
    )


def one_by_one(name: str, command: Callable[..., None]) -> Callable[..., None]:
    """The command as a function of options: each field of a parameter that is a dataclass becomes
    an option of its own.

    name: the command's, for its report.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, type[Any]] = {
        key: kind for key, kind in hints.items() if isinstance(kind, type) and is_dataclass(kind)
    }
    options: list[Parameter] = []
    for parameter in signature(command).parameters.values():
        inside = (
            signature(groups[parameter.name]).parameters
            if parameter.name in groups
            else {parameter.name: parameter}
        )
        options += [
            one.replace(kind=Parameter.KEYWORD_ONLY)
            for key, one in inside.items()
            if key != "command"
        ]

    def run(**given: Any) -> None:
        for key, group in groups.items():
            own = {
                field.name: given.pop(field.name) for field in fields(group) if field.name in given
            }
            given[key] = group(name, **own) if issubclass(group, Report) else group(**own)
        command(**given)

    run.__annotations__ = {one.name: one.annotation for one in options}
    run.__dict__["__signature__"] = Signature(options)
    return run


def version_option(
    version: Annotated[
        bool, typer.Option("--version", metavar="", help="Print the version and exit.")
    ] = False,
) -> None:
    """Options before a command."""
    if version:
        from stereo_seecolor.version import __version__

        write_out(f"{__version__}\n")
        raise typer.Exit


def run_command_line() -> int:
    """Run the command that the program was started with and return its exit code."""
    prepare_streams()
    tune_malloc()
    words = sys.argv[1:]
    with contextlib.nullcontext() if "--verbose" in words else quiet_libraries():
        return exit_code_of(
            lambda: program(_needed(words))(standalone_mode=False, prog_name="stereo-seecolor"),
            as_json="--json" in words,
        )
