"""The examples run, as a newcomer would run them."""

import os
import runpy
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import nbformat
import pytest
from conftest import SampleRun

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
ENVIRONMENT = os.environ | {"PYTHONPATH": str(EXAMPLES.parent), "MPLBACKEND": "Agg"}


@pytest.mark.slow
def test_script_runs_the_sample_dive(
    one_water: SampleRun,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Into a finished run, of which it finds all frames done."""
    out = one_water.copy(tmp_path / "out")
    monkeypatch.setattr(sys, "argv", ["sample_dive.py", str(out)])
    runpy.run_path(str(EXAMPLES / "sample_dive.py"), run_name="__main__")
    shown = capsys.readouterr().out
    assert "12 pairs done, 0 failed" in shown
    assert "mean angular error" in shown


@pytest.mark.slow
def test_notebooks_run(tmp_path: Path) -> None:
    """One after the other in one kernel, which forgets all names between them: it loads the
    program once.
    """
    joined, ends = nbformat.v4.new_notebook(), []
    for notebook in NOTEBOOKS:
        cells = [cell for cell in nbformat.read(notebook, 4).cells if cell.cell_type == "code"]
        typed_cells = ["%reset -f", *(cell.source for cell in cells)]
        joined.cells += map(nbformat.v4.new_code_cell, typed_cells)
        ends.append(len(joined.cells))
    typed, executed = tmp_path / "typed.ipynb", tmp_path / "executed.ipynb"
    nbformat.write(joined, typed)
    read, write = "book = nbformat.read(sys.argv[1], 4)", "nbformat.write(book, sys.argv[2])"
    run = f"import sys, nbformat, nbclient; {read}; nbclient.execute(book); {write}"
    # the warnings of Jupyter are not ours
    command = [sys.executable, "-W", "ignore", "-c", run, str(typed), str(executed)]
    finished = subprocess.run(
        command, cwd=EXAMPLES, env=ENVIRONMENT, capture_output=True, text=True
    )
    assert finished.returncode == 0, finished.stderr
    cells = nbformat.read(executed, 4).cells
    for start, end in pairwise([0, *ends]):
        outputs = [output for cell in cells[start:end] for output in cell.get("outputs", ())]
        assert any("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_stored_without_results(notebook: Path) -> None:
    assert not [cell for cell in nbformat.read(notebook, 4).cells if cell.get("outputs")]
