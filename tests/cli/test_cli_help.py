"""What a newcomer reads: help, examples, completion, the version, and the merged settings."""

import os
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import typer
import yaml
from conftest import Cli

from stereo_seecolor.cli.app import every_command, program
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import load_config

COMMANDS = every_command()
NAMES = list(COMMANDS)
GROUP = typer.main.get_command(program(COMMANDS))


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal on which no line of the help is broken."""
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.setenv("TERM", "dumb")


@pytest.mark.usefixtures("wide")
def test_help_lists_every_command_and_its_panel(cli: Cli) -> None:
    code, printed, _ = cli("--help")
    assert code == 0
    assert all(
        f" {panel} " in printed for panel in {command.panel for command in COMMANDS.values()}
    )
    assert all(re.search(rf"^\W+{name}\s", printed, re.M) for name in NAMES)
    code, printed, said = cli()
    assert (code, said) == (2, "")
    assert "Begin with: stereo-seecolor demo" in printed


def test_the_help_is_broken_by_the_width_of_the_terminal_alone(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line ends where the next word has no room."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "dumb")
    _, printed, _ = cli("--help")
    rows = [re.sub(r"^.(.*).$", r"\1", line) for line in printed.splitlines()]
    for line, following in pairwise(rows):
        if re.match(r" {15,}\S", following) and len(line.rstrip()) > 20:
            assert len(line.rstrip()) + 1 + len(following.split()[0]) > 76, (line, following)


@pytest.mark.usefixtures("wide")
def test_the_options_that_everybody_needs_come_first(cli: Cli) -> None:
    _, printed, _ = cli("run", "--help")
    first_panel = printed.split("Color and map")[0]
    assert re.findall(r"(--[\w-]+) ", first_panel) == [
        "--left",
        "--right",
        "--calib",
        "--bag",
        "--out",
        "--refine",
        "--fuse",
        "--help",
    ]
    assert printed.index("Reporting") > printed.index("--workers")


def test_every_command_has_examples() -> None:
    assert all(command.examples for command in COMMANDS.values())


@pytest.mark.parametrize(
    "line", [line for command in COMMANDS.values() for line in command.examples]
)
def test_the_examples_are_understood(line: str) -> None:
    command, *words = shlex.split(line.split(" > ")[0])
    parser = GROUP.commands[command]  # type: ignore[attr-defined]
    assert parser.make_context(command, words, resilient_parsing=False).params


@pytest.mark.usefixtures("wide")
@pytest.mark.parametrize("command", NAMES)
def test_the_examples_are_in_the_help(cli: Cli, command: str) -> None:
    code, printed, _ = cli(command, "--help")
    assert code == 0
    assert all(f" stereo-seecolor {line}" in printed for line in COMMANDS[command].examples)
    assert "--json" in printed


@pytest.mark.slow
def test_the_terminal_breaks_the_help_and_not_the_source() -> None:
    """A line break of the source within a paragraph would break lines twice at 80 columns."""
    for command in program(every_command()).registered_commands:
        assert command.help
        assert "\n" not in command.help.replace("\n\n", ""), command.name


def test_python_m_completion_and_version() -> None:
    # typer asks the processes above for the shell: where the tests run below none, it finds none
    named = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    for words in (("--version",), ("--show-completion", "bash")):
        program = [sys.executable, "-m", "stereo_seecolor", *words]
        said = subprocess.run(program, capture_output=True, text=True, check=True, env=named)
        assert said.stdout.strip()


def test_the_settings_are_printed_as_a_file_that_gives_them_again(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("mapping: {voxel_m: 0.02}\ncolor: {lock: survey}")
    changes = ("--set", "color.lock=20", "--set", "mapping.mount={rpy_deg: [0, 0, 90]}")
    _, printed, _ = cli("config", "--show", "--config", file, *changes)
    assert f"  voxel_m: 0.02  # {file}\n" in printed
    assert "  lock: 20  # --set\n" in printed
    assert "    rpy_deg: [0.0, 0.0, 90.0]  # --set\n" in printed
    assert "  fill: false  # default\n" in printed
    again = tmp_path / "again.yaml"
    again.write_text(printed)
    assert load_config(again) == load_config(
        file, ["color.lock=20", "mapping.mount.rpy_deg=[0, 0, 90]"]
    )
    assert yaml.safe_load(cli("config")[1]) == RunConfig().model_dump(mode="json")
