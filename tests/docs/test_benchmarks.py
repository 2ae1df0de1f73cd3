"""Every benchmark tells what it measures and what it takes."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
ALL_ANSWER = """
import contextlib, io, runpy, sys
for path in sys.argv[1:]:
    sys.argv, said = [path, "--help"], io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        runpy.run_path(path, run_name="__main__")
    first = said.getvalue().partition("\\n")[0]
    assert first.startswith("usage: ") and path.rpartition("/")[2] in first, (path, first)
"""
"""In one process, which loads the program once."""


@pytest.mark.slow
def test_every_benchmark_answers_help() -> None:
    scripts = [
        path.as_posix()
        for path in sorted(BENCHMARKS.glob("*.py"))
        if "__main__" in path.read_text(encoding="utf-8")
    ]
    assert len(scripts) > 20
    done = subprocess.run(
        [sys.executable, "-c", ALL_ANSWER, *scripts],
        capture_output=True,
        text=True,
        cwd=BENCHMARKS,
    )
    assert done.returncode == 0, done.stderr[-500:]


ARGUMENTS_ALONE = """
[mypy]
check_untyped_defs = True
plugins = pydantic.mypy
[mypy-stereo_seecolor.*,calibration.*]
ignore_errors = True
[mypy-numpy.*,scipy.*,torch.*,cv2.*,PIL.*,matplotlib.*,dask.*,distributed.*,rich.*,typer.*,jinja2.*]
follow_imports = skip
"""
"""mypy skips bodies of functions of the program, and the libraries: in a third of the time."""
GONE = """
from stereo_seecolor.config import RunConfig
from stereo_seecolor.extras.synthetic.survey import SurveySpec

RunConfig(gone=1)
SurveySpec(gone=1)
"""


@pytest.mark.slow
def test_benchmarks_give_functions_the_arguments_that_they_take(tmp_path: Path) -> None:
    """They run for minutes, so mypy looks for settings and parameters that are no longer there."""
    config, gone = tmp_path / "mypy.ini", tmp_path / "gone.py"
    config.write_text(ARGUMENTS_ALONE)
    gone.write_text(GONE)
    cache = BENCHMARKS.parent / ".mypy_cache" / "arguments"
    options = ("--config-file", config, "--cache-dir", cache)
    found = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "benchmarks", "examples", gone],
        capture_output=True,
        text=True,
        cwd=BENCHMARKS.parent,
    )
    assert found.returncode in (0, 1), found.stderr[-500:]
    wrong = [line for line in found.stdout.splitlines() if line.endswith("[call-arg]")]
    assert ["gone.py:5:" in line or "gone.py:6:" in line for line in wrong] == [True, True], wrong


def test_deliberate_breaks_are_of_the_code_as_it_is() -> None:
    names = runpy.run_path(str(BENCHMARKS / "mutations.py"))
    tests = BENCHMARKS.parent / "tests"
    assert len({each.file for each in names["BREAKS"]}) >= 20
    for each in names["BREAKS"]:
        assert not names["missing"](each)
        assert each.new != each.old
        assert all((tests / path).exists() for path in each.tests.split()), each.tests
