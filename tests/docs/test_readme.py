"""What the README tells people to type does what it says."""

import re
from pathlib import Path

import pytest
from conftest import SampleRun

ROOT = Path(__file__).resolve().parents[2]


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(
        rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL
    )


def test_readme_has_two_commands_that_use_the_constraints() -> None:
    setups = [block for block in blocks(ROOT / "README.md", "sh") if "venv" in block]
    assert len(setups) == 2
    assert all("-c constraints.txt" in block and block.count("\n") == 1 for block in setups)


def test_colors_in_the_readme_are_rows_of_the_one_table() -> None:
    page = (ROOT / "docs" / "color-quality.md").read_text(encoding="utf-8").splitlines()
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    head = next(line for line in page if line.startswith("| data | real or drawn"))
    shown = readme[readme.index(head) : readme.index("", readme.index(head))]
    assert len(shown) > 5 and set(shown) <= set(page)


@pytest.mark.slow
def test_readme_run_command_does_the_main_job(sample_run: SampleRun) -> None:
    pairs = len(list((ROOT / "data_samples/reef/left").iterdir()))
    assert f"{pairs} pairs done, 0 failed, 0 files without a partner" in sample_run.printed
    assert len(list((sample_run.out / "corrected").iterdir())) == pairs
    assert f"{pairs} of {pairs} frames fused" in sample_run.printed
    assert "map/orthomosaic.tif: the reef from above, GeoTIFF" in sample_run.printed
    assert "pip install" not in sample_run.printed, "nothing that a map is made with is missing"
    assert {path.name for path in (sample_run.out / "map").iterdir()} >= {
        "preview.png",
        "orthomosaic.tif",
        "dem.tif",
        "mesh.ply",
    }
