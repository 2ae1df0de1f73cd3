"""Whole runs over files with names that are hard to write: outputs and tables stay valid."""

import csv
import os
from pathlib import Path

import pytest

from stereo_seecolor.commands.run import run

ODD_STEMS = {
    "not UTF-8": os.fsdecode(b"caf\xe9"),
    "255 bytes": "x" * 251,
    "a line break": "two\nlines",
    "a line separator": "two\u2028lines",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ODD_STEMS)
def test_a_run_over_odd_names(make_dive, tmp_path: Path, kind: str) -> None:
    dive = make_dive(2)
    for side in "LR":
        (dive.root / side / "0001.png").rename(dive.root / side / f"{ODD_STEMS[kind]}.png")
    # makes two of one name: one row without a partner each
    (dive.root / "L" / f"{ODD_STEMS[kind]}.tif").touch()
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert summary.count("ok") == 1
    (dive.root / "L" / f"{ODD_STEMS[kind]}.tif").unlink()
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert summary.count("ok") == 2
    table = (tmp_path / "out" / "frames.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(table))
    assert len(rows) == 2
    for row in rows:
        assert (tmp_path / "out" / "corrected" / f"{row['name']}.png").is_file()


@pytest.mark.slow
def test_two_empty_files_are_said_to_be_empty(make_dive, tmp_path: Path) -> None:
    dive = make_dive(2)
    for side in "LR":
        (dive.root / side / "0001.png").write_bytes(b"")
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert [row.error for row in summary.rows if row.status == "failed"] == [
        f"{dive.root}/L/0001.png: is empty: copy it again from the vehicle, or leave it out"
    ]
