"""Packages add commands, export formats and formats of trajectories by entry points; the core loads none of its own extras."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REEF, Cli, SampleRun

from stereo_seecolor import plugins
from stereo_seecolor.errors import PluginError

PROJECT = """
[build-system]
requires = ["setuptools"]
build-backend = "setuptools.build_meta"

[project]
name = "reef-notes"
version = "1.0"

[project.entry-points."stereo_seecolor.commands"]
note = "reef_notes:note"
lost = "reef_notes.not_there:lost"

[project.entry-points."stereo_seecolor.exports"]
names = "reef_notes:NAMES"

[project.entry-points."stereo_seecolor.trajectory_formats"]
notes = "reef_notes"

[tool.setuptools]
py-modules = ["reef_notes"]
"""

MODULE = '''
import numpy as np

from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.report import BareReport
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.records import Trajectory


@command("Notes", "note OUT")
def note(out: opt.Finished, *, report: BareReport) -> None:
    """Print the name of a run."""
    report.end({"out": out}, f"noted {out.name}\\n")


def write(posed, folder):
    (folder / "names.txt").write_text("\\n".join(frame.name for frame in posed.frames))


NAMES = ExportFormat("the names of the frames", "any editor", write)


def recognizes(path):
    return path.suffix == ".notes"


def read(path, mount):
    names = path.read_text().split()
    T = np.tile(np.eye(4), (len(names), 1, 1))
    T[:, 0, 3] = np.arange(len(names))
    return Trajectory(tuple(names), np.full(len(names), np.nan), T)
'''


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a Python in which a package of somebody else is installed."""
    root = tmp_path_factory.mktemp("reef-notes")
    (root / "pyproject.toml").write_text(PROJECT)
    (root / "reef_notes.py").write_text(MODULE)
    options = ("--no-deps", "--no-index", "--no-build-isolation", "--quiet", "--target", str(root / "installed"))
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(root)], check=True, capture_output=True)
    return os.environ | {"PYTHONPATH": str(root / "installed"), "COLUMNS": "300", "TERM": "dumb"}


def program(environment: dict[str, str], *words: str | Path) -> tuple[int, str, str]:
    """Run the program: (exit code, what was printed, what was said)."""
    command = [sys.executable, "-m", "stereo_seecolor", *map(str, words)]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment)
    return ended.returncode, ended.stdout, ended.stderr


@pytest.mark.slow
def test_a_command_of_another_package_is_in_the_help_and_runs(installed: dict[str, str], sample_run: SampleRun) -> None:
    code, printed, said = program(installed, "--help")
    assert code == 0
    assert " Notes " in printed and "Print the name of a run." in printed
    assert printed.index(" run ") < printed.index(" config ") < printed.index(" export ")
    assert said.startswith("lost: the package reef-notes, which adds it to commands, cannot be loaded: ")
    assert program(installed, "note", sample_run.out) == (0, f"noted {sample_run.out.name}\n", "")
    code, _, said = program(installed, "lost")
    assert code == 1
    assert "cannot be loaded" in said and "Traceback" not in said


@pytest.mark.slow
def test_an_export_format_of_another_package_is_written(installed: dict[str, str], sample_run: SampleRun, tmp_path: Path) -> None:
    code, printed, _ = program(installed, "export", "--list")
    assert code == 0
    assert "names        the names of the frames: any editor" in printed.splitlines()
    code, _, said = program(installed, "export", sample_run.out, "--to", "names", "--out", tmp_path / "names")
    assert (code, said) == (0, "")
    assert (tmp_path / "names" / "names.txt").read_text().split()[0] == "reef_1790000000000"


@pytest.mark.slow
def test_a_trajectory_format_of_another_package_is_read(installed: dict[str, str], tmp_path: Path) -> None:
    notes = tmp_path / "track.notes"
    notes.write_text("a b c")
    code = "import sys, pathlib; from stereo_seecolor.inputs.trajectories import read_trajectory as read; "
    code += "print(read(pathlib.Path(sys.argv[1])).T_world_camera[:, 0, 3].tolist())"
    ended = subprocess.run([sys.executable, "-c", code, notes], capture_output=True, text=True, env=installed)
    assert ended.stdout == "[0.0, 1.0, 2.0]\n", ended.stderr


def test_a_part_that_no_package_adds_is_named_with_those_that_are_known() -> None:
    with pytest.raises(PluginError, match=r"^fax: no installed package adds it to recordings \(known: mcap\)$"):
        plugins.load("recordings", "fax")


def test_a_cluster_of_an_unknown_kind_is_named(cli: Cli, tmp_path: Path) -> None:
    sides = ("--left", tmp_path, "--right", tmp_path, "--calib", "cam.yaml")
    code, _, said = cli("run", *sides, "--out", tmp_path / "out", "--cluster", "cloud:4")
    assert code == 1
    assert "--cluster cloud:4: is not a cluster: give one of htcondor, local, " in said
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_run_and_an_import_load_no_extra(tmp_path: Path) -> None:
    code = "import sys, stereo_seecolor; from stereo_seecolor.cli import main\n"
    code += "try: main()\nexcept SystemExit as end: print(end.code)\n"
    code += "print([name for name in sys.modules if name.startswith('stereo_seecolor.extras')])"
    sides = ("--left", REEF / "left", "--right", REEF / "right", "--calib", REEF / "cam.yaml")
    words = ("run", *map(str, sides), "--out", str(tmp_path / "out"), "--fuse", "--progress", "none")
    ended = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert ended.stdout.splitlines()[-2:] == ["0", "[]"], ended.stderr
