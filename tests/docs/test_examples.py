"""The examples run, as a newcomer would run them."""

import os
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from conftest import SampleRun

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(EXAMPLES.parent), "MPLBACKEND": "Agg"}


@pytest.mark.slow
def test_script_runs_the_sample_dive(one_water: SampleRun, tmp_path: Path) -> None:
    """Into a finished run, of which it finds all frames done."""
    out = one_water.copy(tmp_path / "out")
    command = [sys.executable, str(EXAMPLES / "sample_dive.py"), str(out)]
    shown = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    assert "12 pairs done, 0 failed" in shown.stdout
    assert "mean angular error" in shown.stdout


@pytest.mark.slow
@pytest.mark.parametrize("notebook", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_runs(notebook: Path, tmp_path: Path) -> None:
    executed = tmp_path / "executed.ipynb"
    read, write = "book = nbformat.read(sys.argv[1], 4)", "nbformat.write(book, sys.argv[2])"
    run = f"import sys, nbformat, nbclient; {read}; nbclient.execute(book); {write}"
    # the warnings of Jupyter are not ours
    command = [sys.executable, "-W", "ignore", "-c", run, str(notebook), str(executed)]
    finished = subprocess.run(
        command, cwd=EXAMPLES, env=ENVIRONMENT, capture_output=True, text=True
    )
    assert finished.returncode == 0, finished.stderr
    cells = [cell for cell in nbformat.read(executed, 4).cells if cell.cell_type == "code"]
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.outputs)


@pytest.mark.parametrize("notebook", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_is_stored_without_results(notebook: Path) -> None:
    assert not [cell for cell in nbformat.read(notebook, 4).cells if cell.get("outputs")]
