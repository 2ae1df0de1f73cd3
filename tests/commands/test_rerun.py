"""Runs after runs: what is current is kept, what is lost, damaged or changed is made again, a water
serves another dive.
"""

import json

import cv2
import pytest
from conftest import contents, read_pixels

from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.run_folder.finished_run import open_run


@pytest.mark.slow
def test_second_run_keeps_everything(copy_run, make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    copy_run(out)
    before = {
        path: path.stat().st_mtime_ns
        for path in out.rglob("*")
        if path.parent.name in ("range", "corrected", "clouds")
    }
    code, printed, _ = cli(*dive.command(out))
    assert code == 0
    assert "3 of them kept" in printed
    assert before == {path: path.stat().st_mtime_ns for path in before}


@pytest.mark.slow
def test_only_what_depends_on_a_change_is_done_again(copy_run, make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    copy_run(out)
    ranges = {path: path.stat().st_mtime_ns for path in (out / "range").iterdir()}
    cli(*dive.command(out, "--set", "color.median_luminance=0.1"))
    assert ranges == {path: path.stat().st_mtime_ns for path in ranges}, (
        "ranges do not depend on color settings"
    )
    cv2.imwrite(str(dive.root / "R" / "0001.png"), read_pixels(dive.root / "R" / "0001.png") // 2)
    cli(*dive.command(out))
    changed = {path.stem for path, then in ranges.items() if path.stat().st_mtime_ns != then}
    assert changed == {"0001"}


@pytest.mark.slow
def test_a_lost_output_is_made_again(copy_run, make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    copy_run(out)
    before = contents(out)
    (out / "range/0001.tiff").unlink()
    (out / "corrected/0002.png").unlink()
    (out / "clouds/0000.ply").unlink()
    cli(*dive.command(out))
    assert contents(out) == before


@pytest.mark.slow
def test_what_was_damaged_since_is_made_again(copy_run, make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    copy_run(out)
    before = contents(out)
    range_map = out / "range/0000.tiff"
    range_map.write_bytes(range_map.read_bytes()[:100])
    (out / "confidence/0001.png").write_bytes(b"")
    (out / ".state/frames/0002.json").write_text('{"key": 5')
    record = json.loads((out / ".state/frames/0001.json").read_text())
    record["stages"]["corrected"]["facts"] = [1]
    record["files"] = 5
    (out / ".state/frames/0001.json").write_text(json.dumps(record))
    code, _, said = cli(*dive.command(out))
    assert code == 0, said
    assert contents(out) == before


@pytest.mark.slow
def test_water_of_one_dive_serves_another(copy_run, make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    copy_run(tmp_path / "a", 3, "color.lock=survey")
    code, _, _ = cli(*dive.command(tmp_path / "b", "--water", str(tmp_path / "a/water.json")))
    assert code == 0
    assert (tmp_path / "b/water.json").read_bytes() == (tmp_path / "a/water.json").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("run.json", "{", "holds no finished run"),
        ("run.json", "[1]", "run.json: is not a run.json of this program"),
        (
            "run.json",
            '{"format": "stereo-seecolor/run", "geometry": {"focal": 3}}',
            "run.json: was written by another version",
        ),
        (".state/manifest.json", "{", "manifest.json: is damaged or of another version"),
    ],
)
def test_a_damaged_run_is_not_fused(copy_run, tmp_path, name, content, message) -> None:
    copy_run(tmp_path / "out", 1)
    (tmp_path / "out" / name).write_text(content)
    with pytest.raises(SeeColorError, match=message):
        open_run(tmp_path / "out")
