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


def table(path: Path, head: str) -> list[dict[str, str]]:
    """The rows of the table whose header line begins so, by column."""
    lines = path.read_text(encoding="utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(head))
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[first:]]
    end = next(i for i, row in enumerate(rows) if row == [""])
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:end]]


def test_colors_in_the_readme_are_those_of_the_one_table() -> None:
    """The best other method is the best of the page, and raw and own numbers are the page's."""
    page = table(ROOT / "docs" / "color-quality.md", "| data | real or synthetic")
    others = ("gray world", "log-linear gray world", "Sea-thru", "DeepSeeColor")
    shown = table(ROOT / "README.md", "| error | data")
    compared = 0
    for row in shown:
        data = row["data"].removesuffix(" (**real**)")
        found = [each for each in page if each["data"] == data]
        if not found:
            continue
        which = 1 if row["error"].startswith("change of a patch") else 0
        values = {
            name: cell.split(", ")[which] if ", " in cell else cell
            for name, cell in found[0].items()
        }
        best, method = re.fullmatch(r"\**([\d.]+)\** \((.+)\)", row["best other method"]).groups()
        assert row["raw"] == values["raw"] and row["stereo-seecolor"] == values["stereo-seecolor"]
        assert float(best) == min(float(values[name]) for name in others)
        assert best == values[method]
        compared += 1
    assert compared == 5 and len(shown) <= 8


def test_the_readme_is_short() -> None:
    """What a newcomer reads in five minutes; the rest is by link."""
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 900


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
