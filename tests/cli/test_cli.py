"""The command line: usage, what starts it, and the demo."""

import subprocess
import sys
from pathlib import Path

import pytest

from stereo_seecolor.cli.options import DEFAULT_WORKERS
from stereo_seecolor.compute.threads import cores
from stereo_seecolor.extras.synthetic.demo import DemoResult


def test_wrong_usage(cli) -> None:
    assert cli("run", "--left", "L")[0] == 2
    assert cli("runn")[0] == 2
    assert (
        cli("run", "--left", "L", "--right", "R", "--calib", "c.yaml", "--poses", "p.tum")[0] == 2
    )


def test_a_value_that_is_given_twice_is_refused(cli) -> None:
    """The first folder would be left out; --set is for many, and a flag says the same twice."""
    for words in (("--left", "a", "--left", "b"), ("--left=a", "--right", "c", "--left", "b")):
        code, _, said = cli("run", *words)
        assert (code, "--left is given twice: give it once" in said) == (2, True)
    settings = ("--set", "color.lock=auto", "--set", "color.lock=40", "--json", "--json")
    code, printed, _ = cli("config", *settings)
    assert (code, '"value": 40' in printed) == (0, True)


def test_a_pair_more_than_cores_is_under_way() -> None:
    """While one waits for the disk."""
    assert min(cores() + 1, 8) == DEFAULT_WORKERS


@pytest.mark.slow
def test_installed_command_and_version() -> None:
    program = Path(sys.executable).parent / "stereo-seecolor"
    assert subprocess.run(
        [program, "--version"], capture_output=True, text=True, check=True
    ).stdout.strip()
    help_text = subprocess.run(
        [program, "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert all(command in help_text for command in ("run", "correct", "range", "rectify", "doctor"))


@pytest.mark.slow
def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys; sys.argv = ['x', '--help']\n"
        "from stereo_seecolor.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = 'numpy torch numba cv2 open3d rasterio scipy pydantic yaml'.split()\n"
        "print('HEAVY', sorted(set(heavy) & sys.modules.keys()))"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert "HEAVY []" in printed


@pytest.mark.slow
@pytest.mark.usefixtures("demo_at_hand")
def test_demo_shows_how_near_the_truth_it_comes(cli, finished_demo: DemoResult) -> None:
    code, printed, _ = cli("demo")
    assert code == 0
    assert "4 pairs done" in printed
    assert "median error" in printed
    assert len(list((finished_demo.out / "corrected").iterdir())) == 4
