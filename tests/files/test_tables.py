"""Cells that a spreadsheet would run as formulas: written so that it shows them, read as they
were.
"""

import csv
import io
from pathlib import Path

import pytest

from stereo_seecolor.files.csv_tables import csv_text, rows, split_fields, table_rows
from stereo_seecolor.inputs.exposure_table import ExposureTable
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.frames_csv import frames_csv, read_frames

FORMULAS = ("=cmd|'calc'!A1", "+1+2", "-2-3", "@SUM(A1)", "'=1", "''=1", "-", "\t=1", "= 1", "-x")
PLAIN = ("-1.5", "+2", "-1e-3", "a=b", "'a", "reef", "", "é", "1-2", "-inf")


@pytest.mark.parametrize("text", FORMULAS + PLAIN)
def test_no_cell_is_a_formula_and_each_is_read_as_it_was(text: str, tmp_path: Path) -> None:
    table = csv_text(["name", "x"], [[text, -1.5], ["a", 2]])
    cell = next(csv.DictReader(io.StringIO(table)))["name"]
    assert (cell == text) == (text in PLAIN)
    assert text in PLAIN or cell[0] == "'"
    assert "-1.5" in table
    (tmp_path / "table.csv").write_text(table, newline="")
    assert next(table_rows(table.encode()))["name"] == text
    assert next(rows(tmp_path / "table.csv", ["name"]))[1]["name"] == text
    assert text != text.strip() or split_fields(table.splitlines()[1], ",")[0] == text


@pytest.mark.parametrize("name", FORMULAS)
def test_a_frame_may_be_called_as_a_formula(name: str, tmp_path: Path) -> None:
    row = FrameRow(name.strip(), left=f"{name.strip()}.png", warnings=("-1.0 px off", "=a"))
    (tmp_path / "frames.csv").write_bytes(b"".join(frames_csv([row])))
    assert read_frames(tmp_path / "frames.csv", ()) == (row,)
    cells = next(csv.DictReader(io.StringIO((tmp_path / "frames.csv").read_text())))
    assert not {cells[key][:1] for key in ("name", "left", "warnings")} & set("=+-@")


def test_a_log_of_exposures_may_name_such_frames(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(csv_text(["name", "exposure_ms"], [["=a.png", 2.0]]))
    assert "=a.png" in str(vars(ExposureTable.read(tmp_path / "log.csv")))
