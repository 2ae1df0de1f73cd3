"""--json of every command: one valid JSON object on standard output, of the shape that scripts rely
on, errors included.
"""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_writers import camera_infos, dive_messages, name_by_stamps, write_bag
from calibration_texts import ROS_LEFT, ROS_RIGHT
from conftest import Cli
from json_shapes import ERROR, SHAPES, mismatch
from video_writers import write_pair

from calibration.verification.table import MOVED, RADIANS, Cause
from stereo_seecolor.cli.app import every_command
from stereo_seecolor.extras.synthetic.demo import DemoResult
from stereo_seecolor.files.json_values import json_line, plain

ROOT = Path(__file__).resolve().parents[2]
TRACK = "# timestamp tx ty tz qx qy qz qw\n" + "".join(
    f"{i:04d} {0.01 * i} 0 0 1 0 0 0\n" for i in range(2)
)


@pytest.fixture
def parsed(cli: Cli) -> Callable[..., dict[str, Any]]:
    """Run a command with --json and check the shape of what it prints, and the exit code that it
    names.
    """

    def call(shape: str, *words: str | Path) -> dict[str, Any]:
        code, printed, said = (
            cli(*words, "--json", "--progress", "none")
            if takes_progress(words[0])
            else cli(*words, "--json")
        )
        assert printed.count("\n") == 1, said
        content: dict[str, Any] = json.loads(printed, parse_constant=pytest.fail)
        assert mismatch(content, SHAPES[shape]) is None
        assert (content["command"], content["exit_code"]) == (words[0], code)
        return content

    return call


def takes_progress(command: str | Path) -> bool:
    return command in (
        "run",
        "merge",
        "campaign",
        "range",
        "correct",
        "rectify",
        "fuse",
        "demo",
        "synthesize",
        "calibrate",
    )


def test_every_command_has_a_shape_here() -> None:
    assert set(every_command()) == {shape.split()[0] for shape in SHAPES}


@pytest.mark.slow
def test_the_commands_over_pairs(make_dive, parsed, tmp_path) -> None:
    dive = make_dive(2)
    (dive.root / "R/0001.png").write_bytes(b"")
    run = parsed("run", *dive.command(tmp_path / "out"))
    assert (run["ok"], run["failed"], run["exit_code"]) == (1, 1, 3)
    assert run["failed_pairs"][0]["name"] == "0001"
    assert "is empty" in run["failed_pairs"][0]["error"]
    parsed("range", *dive.command(tmp_path / "ranges", command="range"))
    parsed("rectify", *dive.command(tmp_path / "rectified", command="rectify"))
    words = (
        "--images",
        dive.root / "L",
        "--range",
        tmp_path / "out/range",
        "--out",
        tmp_path / "colors",
    )
    correct = parsed("correct", "correct", *words)
    assert (correct["ok"], correct["unpaired_files"]) == (1, 1)


@pytest.mark.slow
def test_campaigns_and_plans(make_dive, parsed, tmp_path) -> None:
    dive = make_dive(2)
    file = tmp_path / "campaign.yaml"
    file.write_text(
        "{out: results, dives: [{name: a, left: dive/L, right: dive/R, calib: dive/cam.yaml}]}"
    )
    assert [row["ok"] for row in parsed("campaign", "campaign", file)["dives"]] == [2]
    plan = parsed("plan", *dive.command(tmp_path / "out", command="plan")[:-2])
    assert (plan["pairs"], plan["measured"]) == (2, 2)


@pytest.mark.slow
def test_shards_and_states(make_dive, parsed, tmp_path) -> None:
    dive = make_dive(2)
    (dive.root / "R/0001.png").write_bytes(b"")
    parsed("run", *dive.command(tmp_path / "part", "--shard", "1/1"))
    assert parsed("merge", "merge", tmp_path / "part", "--out", tmp_path / "merged")["ok"] == 1
    runs = parsed("status", "status", tmp_path / "merged", tmp_path / "part")["runs"]
    assert [run["state"] for run in runs] == ["complete", "complete"]
    assert runs[0]["failures"][0][1:] == [1, "0001"]


@pytest.mark.slow
def test_a_dive_before_it_is_run(make_dive, parsed) -> None:
    dive = make_dive(2)
    found = parsed("inspect", "inspect", dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    assert (found["pairs"], found["misfits"]) == (2, [])
    assert found["run_command"].startswith("stereo-seecolor run --left ")
    check = parsed("check", *dive.command(Path("out"), command="check")[:-2])
    assert (check["acceptable"], check["refined"]) == (True, None)


def test_a_bag(make_dive, parsed, tmp_path) -> None:
    dive = make_dive(1)
    name_by_stamps(dive.root)
    sent = [*camera_infos(dive.root / "cam.yaml"), *dive_messages(dive.root)]
    found = parsed("bag-info", "bag-info", write_bag(tmp_path / "b.bag", sent))
    assert (found["pairs"], found["left"]) == (1, "/stereo/left/image_raw")


@pytest.mark.slow
def test_live(make_dive, parsed) -> None:
    dive = make_dive(1)
    words = (
        "--left",
        dive.root / "L",
        "--right",
        dive.root / "R",
        "--calib",
        dive.root / "cam.yaml",
        "--pairs",
        "1",
    )
    assert parsed("live", "live", *words)["done"] == 1


@pytest.mark.slow
def test_two_videos(parsed, tmp_path) -> None:
    assert parsed("sync", "sync", *write_pair(tmp_path, 0.1, seconds=6))["pairs"] > 150


@pytest.mark.slow
def test_the_map_is_part_of_the_object(make_dive, parsed, tmp_path) -> None:
    dive, poses = make_dive(2), tmp_path / "track.tum"
    poses.write_text(TRACK)
    more = (
        "--poses",
        poses,
        "--set",
        "mapping.voxel_m=0.05",
        "--set",
        "mapping.poses_of=rectified",
    )
    run = parsed("run --fuse", *dive.command(tmp_path / "out"), "--fuse", *more)
    assert run["map"]["placed"] == 2
    fuse = parsed("fuse", "fuse", tmp_path / "out", *more)
    assert fuse["map"]["points"] == run["map"]["points"]
    assert str(tmp_path / "out/map/mesh.ply") in fuse["map"]["files"]


@pytest.mark.slow
def test_known_truth(parsed, demo_at_hand: DemoResult, tmp_path) -> None:
    out = demo_at_hand.out
    demo = parsed("demo", "demo")
    assert demo["ok"] == len(demo["truth"]["frames"]) == 4
    scores = parsed("evaluate", "evaluate", out, "--truth", out.parent / "dive/truth")
    assert scores["range"] == demo["truth"]["range"]
    words = ("--pairs", "1", "--lines", "1", "--size", "64x64", "--seed", "3")
    assert (
        parsed("synthesize", "synthesize", "--out", tmp_path / "dive", *words)["spec"]["seed"] == 3
    )


def test_charts(parsed, tmp_path, monkeypatch) -> None:
    from stereo_seecolor.extras.evaluation.charts import scores

    row = scores.ChartRow("a", "chart", "raw", math.nan, 3.0, 2.0, 5.0, 0.0, 9.0, 100)
    report = scores.ChartReport((row,), ("b",), tmp_path / "sheet.png")
    monkeypatch.setattr(scores, "evaluate_charts", lambda *_: report)
    content = parsed(
        "evaluate --chart", "evaluate", "--chart", "--images", tmp_path, "--range", tmp_path
    )
    assert content["rows"][0]["range_m"] is None
    assert content["means"][0]["psi_deg"] == 3.0


def test_calibrations(parsed, tmp_path) -> None:
    (tmp_path / "left.yaml").write_text(ROS_LEFT)
    (tmp_path / "right.yaml").write_text(ROS_RIGHT)
    converted = parsed("convert-calib", "convert-calib", tmp_path, tmp_path / "cam.yaml")
    assert converted["out"] == str(tmp_path / "cam.yaml")
    target = ("--target", "chessboard:7x5:40mm", "--print-target", tmp_path / "board.pdf")
    assert parsed("calibrate --print-target", "calibrate", *target)["target"] == str(
        tmp_path / "board.pdf"
    )


def test_the_water(parsed, tmp_path, monkeypatch) -> None:
    from stereo_seecolor.extras.evaluation import water

    zero = np.zeros(3)
    measured = water.Water(*(zero for _ in range(8)), standard_errors={"y": np.full(3, np.nan)})
    monkeypatch.setattr(
        water, "measure_water", lambda *_: water.MeasuredWater(tmp_path / "w.json", measured)
    )
    (tmp_path / "run.json").write_text("{}")
    content = parsed(
        "water", "water", tmp_path, "--poses", tmp_path / "p.tum", "--config", empty(tmp_path)
    )
    assert content["water"]["standard_errors"] == {"y": [None, None, None]}


def empty(folder: Path) -> Path:
    """A file of no settings."""
    (folder / "empty.yaml").write_text("")
    return folder / "empty.yaml"


def test_the_viewer(parsed, tmp_path, monkeypatch) -> None:
    from stereo_seecolor.commands import view

    monkeypatch.setattr(view, "view", lambda out: view.ViewResult(out / "map/mesh.ply", "rerun"))
    assert parsed("view", "view", tmp_path)["viewer"] == "rerun"


def test_an_export(parsed, tmp_path, monkeypatch) -> None:
    from stereo_seecolor.extras.export import command as export

    monkeypatch.setattr(
        export, "export", lambda out, to, folder: export.ExportResult(to, folder, 3, 4, 5)
    )
    assert (
        parsed("export", "export", tmp_path, "--to", "glb", "--out", tmp_path / "glb")["frames"]
        == 3
    )


@pytest.mark.slow
def test_settings_and_machine(parsed) -> None:
    settings = {
        row["key"]: row
        for row in parsed("config", "config", "--set", "color.lock=survey")["settings"]
    }
    assert (settings["color.lock"]["value"], settings["color.lock"]["origin"]) == (
        "survey",
        "--set",
    )
    assert parsed("doctor", "doctor")["ready"]


@pytest.mark.parametrize(
    ("words", "exit_code", "message"),
    [
        (("fuse", "nowhere"), 1, "nowhere"),
        (("evaluate",), 2, "give the folder of a run with --truth"),
        (("run", "--left", "L"), 2, "--right is missing"),
        (("config", "--set", "color.lok=survey"), 1, "did you mean 'color.lock'"),
    ],
)
def test_an_error_is_an_object_and_a_line(cli: Cli, words, exit_code, message) -> None:
    code, printed, said = cli(*words, "--json")
    content = json.loads(printed)
    assert mismatch(content, ERROR) is None
    assert (code, content["exit_code"]) == (exit_code, exit_code)
    assert message in content["error"]
    assert said.splitlines()[-1] == f"stereo-seecolor: {content['error']}"


def test_whatever_a_result_holds_is_valid_json() -> None:
    odd = {
        "numbers": (math.nan, math.inf, np.float32(-np.inf), np.int64(3), np.bool_(True)),
        "array": np.array([[1.0, np.nan]]),
        "path": Path("a/\udcff\u00e4"),
        7: {"set": {1}},
    }
    line = json_line(odd)
    assert line.isascii()
    assert json.loads(line, parse_constant=pytest.fail) == {
        "numbers": [None, None, None, 3, True],
        "array": [[1.0, None]],
        "path": "a/\udcff\u00e4",
        "7": {"set": [1]},
    }
    assert plain(np.float64(0.1)) == 0.1


def test_a_cause_is_its_numbers_and_not_the_function_that_undoes_it() -> None:
    cause = Cause("a roll of {} +- {} degrees", RADIANS, MOVED, lambda rig, _: rig)
    assert plain(cause).keys() == {"text", "amount", "cure", "below"}


def test_a_shape_notices_what_is_missing_and_what_is_new() -> None:
    content = {"command": "view", "exit_code": 0, "out": "o", "mesh": "m"}
    assert mismatch(content, SHAPES["view"]) == "$: missing ['viewer'], unexpected []"
    assert (
        mismatch({**content, "viewer": 3}, SHAPES["view"]) == "$.viewer is 3, not (<class 'str'>,)"
    )
    assert "unexpected ['more']" in str(
        mismatch({**content, "viewer": "v", "more": 1}, SHAPES["view"])
    )


def test_the_documentation_names_every_key() -> None:
    text = (ROOT / "docs/json.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+)`", text))
    assert {key for shape in SHAPES.values() for key in keys(shape)} <= named


def keys(shape: Any) -> set[str]:
    """All keys of a shape, at any depth."""
    if isinstance(shape, list):
        return keys(shape[0])
    if not isinstance(shape, dict):
        return set()
    return {key for key in shape if isinstance(key, str)} | {
        key for value in shape.values() for key in keys(value)
    }
