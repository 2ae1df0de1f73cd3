"""What the README tells people to type does what it says."""

import re
import shlex
from pathlib import Path

import pytest

from stereo_seecolor.cli import main

ROOT = Path(__file__).resolve().parents[1]


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL)


def test_readme_has_two_commands_that_use_the_constraints() -> None:
    setups = [block for block in blocks(ROOT / "README.md", "sh") if "venv" in block]
    assert len(setups) == 2
    assert all("-c constraints.txt" in block and block.count("\n") == 1 for block in setups)


@pytest.mark.slow
def test_readme_run_command_does_the_main_job(tmp_path, monkeypatch, capsys) -> None:
    command = next(block for block in blocks(ROOT / "README.md", "sh") if "data_samples" in block)
    words = shlex.split(command.split("&&")[-1])
    assert words[0] == ".venv/bin/stereo-seecolor"
    (tmp_path / "data_samples").symlink_to(ROOT / "data_samples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code in (0, None)
    printed = capsys.readouterr().out
    pairs = len(list((ROOT / "data_samples/reef/left").iterdir()))
    assert f"{pairs} pairs done, 0 failed, 0 files without a partner" in printed
    assert len(list((tmp_path / "out/corrected").iterdir())) == pairs
    assert f"{pairs} of {pairs} frames fused" in printed
    assert "pip install" not in printed, "nothing that a map is made with is missing"
    assert {path.name for path in (tmp_path / "out/map").iterdir()} >= {"preview.png", "orthomosaic.tif", "dem.tif", "mesh.ply"}
