"""The command line as a user types it: what comes out, what is said, and the exit code."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from conftest import contents

from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.run_folder.finished_run import open_run


def read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


@pytest.mark.slow
def test_run_writes_the_whole_folder(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    code, printed, said = cli(*dive.command(out))
    assert code == 0, said
    assert "3 pairs done, 0 failed" in printed
    assert str(out / "corrected") in printed
    names = {"0000", "0001", "0002"}
    for product, suffix in (("corrected", "png"), ("range", "tiff"), ("range_std", "tiff"), ("clouds", "ply"), ("mask", "png")):
        assert {path.name for path in (out / product).iterdir()} == {f"{name}.{suffix}" for name in names}
    range_m = read(out / "range" / "0001.tiff")
    known = np.isfinite(range_m)
    assert range_m.dtype == np.float32
    assert known.mean() > 0.6
    error_px = 15 * np.abs(1 / range_m - 1 / dive.range_m)[known]  # f B = 15 px m
    assert np.median(error_px) < 0.2
    corrected = read(out / "corrected" / "0001.png")
    assert corrected.dtype == np.uint8
    assert corrected[known].any(axis=1).mean() > 0.9
    mask = read(out / "mask" / "0001.png")
    assert (mask[~known] != 0).all()
    assert corrected[mask == 2].any(axis=1).mean() > 0.9
    rows = list(csv.DictReader((out / "frames.csv").read_text().splitlines()))
    assert [(row["name"], row["status"]) for row in rows] == [(name, "ok") for name in sorted(names)]
    assert all(float(row["coverage"]) > 0.6 and float(row["match_s"]) > 0 for row in rows)
    run = json.loads((out / "run.json").read_text())
    assert run["totals"]["ok"] == 3
    assert run["geometry"]["baseline_m"] == pytest.approx(0.1)
    assert len(run["inputs"]["files"]["0000"]["left"]) == 64
    assert run["config"]["color"]["lock"]
    assert json.loads((out / "water.json").read_text())["format"] == "stereo-seecolor/water"


def test_cloud_holds_the_measured_points_in_the_corrected_colors(make_dive, cli, tmp_path) -> None:
    cli(*make_dive(1).command(tmp_path / "out"))
    _, _, body = (tmp_path / "out/clouds/0000.ply").read_bytes().partition(b"end_header\n")
    vertices = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]))
    range_m = read(tmp_path / "out/range/0000.tiff")
    measured = np.isfinite(range_m) & (read(tmp_path / "out/confidence/0000.png") > 0)
    assert len(vertices) == measured.sum()
    np.testing.assert_allclose(np.linalg.norm(vertices["xyz"], axis=1), range_m[measured], rtol=1e-5)
    np.testing.assert_array_equal(vertices["rgb"], read(tmp_path / "out/corrected/0000.png")[..., ::-1][measured])
    assert (vertices["xyz"][:, 2] > 0).all()


@pytest.mark.slow
def test_sixteen_bits_in_sixteen_bits_out(make_dive, cli, tmp_path) -> None:
    assert cli(*make_dive(1, dtype=np.uint16).command(tmp_path / "out"))[0] == 0
    corrected = read(tmp_path / "out/corrected/0000.png")
    assert corrected.dtype == np.uint16
    assert len(np.unique(corrected)) > 1000


@pytest.mark.slow
@pytest.mark.parametrize("image_format", ["png16", "tiff32", "jpg"])
def test_image_formats(make_dive, cli, tmp_path, image_format) -> None:
    assert cli(*make_dive(1).command(tmp_path / "out", "--set", f"output.image_format={image_format}"))[0] == 0
    suffix = {"png16": "png", "tiff32": "tiff", "jpg": "jpg"}[image_format]
    image = read(tmp_path / "out/corrected" / f"0000.{suffix}")
    assert image.dtype == {"png16": np.uint16, "tiff32": np.float32, "jpg": np.uint8}[image_format]
    assert np.isfinite(image).all()
    assert image.any()


def test_gray_images_go_through(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    for path in dive.root.glob("?/*.png"):
        cv2.imwrite(str(path), read(path)[..., 1])
    assert cli(*dive.command(tmp_path / "out"))[0] == 0


def test_result_is_the_same_with_any_number_of_workers(make_dive, cli, tmp_path) -> None:
    dive = make_dive(4)
    cli(*dive.command(tmp_path / "one", "--workers", "1"))
    cli(*dive.command(tmp_path / "three", "--workers", "3"))
    assert contents(tmp_path / "one") == contents(tmp_path / "three")


def test_second_run_keeps_everything(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    cli(*dive.command(out))
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.parent.name in ("range", "corrected", "clouds")}
    code, printed, _ = cli(*dive.command(out))
    assert code == 0
    assert "3 of them kept" in printed
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_only_what_depends_on_a_change_is_done_again(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    cli(*dive.command(out))
    ranges = {path: path.stat().st_mtime_ns for path in (out / "range").iterdir()}
    cli(*dive.command(out, "--set", "color.clipped_fraction=0.1"))
    assert ranges == {path: path.stat().st_mtime_ns for path in ranges}, "ranges do not depend on color settings"
    cv2.imwrite(str(dive.root / "R" / "0001.png"), read(dive.root / "R" / "0001.png") // 2)
    cli(*dive.command(out))
    changed = {path.stem for path, then in ranges.items() if path.stat().st_mtime_ns != then}
    assert changed == {"0001"}


def test_a_lost_output_is_made_again(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    cli(*dive.command(out))
    before = contents(out)
    (out / "range/0001.tiff").unlink()
    (out / "corrected/0002.png").unlink()
    (out / "clouds/0000.ply").unlink()
    cli(*dive.command(out))
    assert contents(out) == before


def test_what_was_damaged_since_is_made_again(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(), tmp_path / "out"
    cli(*dive.command(out))
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


def test_water_of_one_dive_serves_another(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    cli(*dive.command(tmp_path / "a", "--set", "color.lock=survey"))
    code, _, _ = cli(*dive.command(tmp_path / "b", "--water", str(tmp_path / "a/water.json")))
    assert code == 0
    assert (tmp_path / "b/water.json").read_bytes() == (tmp_path / "a/water.json").read_bytes()


def test_range_alone_and_correct_alone_give_the_same_images(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    assert cli(*dive.command(tmp_path / "all"))[0] == 0
    assert cli(*dive.command(tmp_path / "ranges", command="range"))[0] == 0
    assert not (tmp_path / "ranges/corrected").exists()
    words = [
        "correct",
        "--images",
        str(dive.root / "L"),
        "--range",
        str(tmp_path / "ranges/range"),
        "--out",
        str(tmp_path / "colors"),
    ]
    assert cli(*words)[0] == 0
    for path in (tmp_path / "all/corrected").iterdir():
        assert (tmp_path / "colors/corrected" / path.name).read_bytes() == path.read_bytes()


def test_rectified_images_need_no_more_rectification(make_dive, cli, tmp_path) -> None:
    dive, out = make_dive(1), tmp_path / "out"
    assert cli(*dive.command(out, command="rectify"))[0] == 0
    np.testing.assert_array_equal(read(out / "rectified_left/0000.png"), read(dive.root / "L/0000.png"))
    again = ["run", "--left", str(out / "rectified_left"), "--right", str(out / "rectified_right")]
    assert cli(*again, "--calib", str(out / "rectified.yaml"), "--out", str(tmp_path / "out2"))[0] == 0


def test_more_lefts_than_rights(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    (dive.root / "R/0001.png").unlink()
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert "L/0001.png: no right image matches" in printed
    assert "2 pairs done, 0 failed, 1 files without a partner" in printed
    rows = {row["name"]: row["status"] for row in csv.DictReader((tmp_path / "out/frames.csv").read_text().splitlines())}
    assert rows == {"0000": "ok", "0001": "unpaired", "0002": "ok"}


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:900]), "R/0001.png: is truncated"),
        (lambda path: path.write_bytes(b""), "R/0001.png: is empty"),
        (
            lambda path: cv2.imwrite(str(path), np.zeros((64, 64, 3), np.uint8)),
            "the right image is 64x64 px but the calibration is for",
        ),
    ],
    ids=["truncated", "empty", "another size"],
)
def test_a_bad_image_is_named_and_the_rest_go_on(make_dive, cli, tmp_path, spoil, message) -> None:
    dive = make_dive()
    spoil(dive.root / "R/0001.png")
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert message in printed
    assert "2 pairs done, 1 failed" in printed
    assert {path.stem for path in (tmp_path / "out/corrected").iterdir()} == {"0000", "0002"}


def test_strict_stops_at_the_first_bad_pair(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    (dive.root / "R/0001.png").write_bytes(b"")
    code, _, said = cli(*dive.command(tmp_path / "out", "--strict"))
    assert code == 1
    assert "R/0001.png: is empty" in said
    rows = {row["name"]: row["status"] for row in csv.DictReader((tmp_path / "out/frames.csv").read_text().splitlines())}
    assert rows == {"0000": "pending", "0001": "failed", "0002": "pending"}


def test_of_many_bad_pairs_a_few_are_named_and_the_rest_counted(make_dive, cli, tmp_path) -> None:
    dive = make_dive(2)
    for i in range(2, 32):
        (dive.root / f"L/{i:04d}.png").write_bytes(bytes(i))
        (dive.root / f"R/{i:04d}.png").write_bytes(b"other")
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert printed.count("failed: ") == 20
    assert f"and 10 more, named in {tmp_path / 'out/frames.csv'}" in printed
    assert (tmp_path / "out/frames.csv").read_text().count(",failed,") == 30


def test_no_left_image_can_be_read(make_dive, cli, tmp_path) -> None:
    dive = make_dive(2)
    for path in (dive.root / "L").iterdir():
        path.write_bytes(b"")
    code, _, said = cli(*dive.command(tmp_path / "out"))
    assert code == 1
    assert "none of the 2 left images can be read; the first: " in said
    assert "L/0000.png: is empty" in said


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("run.json", "{", "holds no finished run"),
        ("run.json", "[1]", "run.json: is no run.json of this program"),
        ("run.json", '{"format": "stereo-seecolor/run", "geometry": {"focal": 3}}', "run.json: was written by another version"),
        (".state/manifest.json", "{", "manifest.json: is damaged or of another version"),
    ],
)
def test_a_damaged_run_is_not_fused(make_dive, tmp_path, cli, name, content, message) -> None:
    cli(*make_dive(1).command(tmp_path / "out"))
    (tmp_path / "out" / name).write_text(content)
    with pytest.raises(SeeColorError, match=message):
        open_run(tmp_path / "out")


def change(rig: dict, key: str, value: object) -> None:
    *path, last = key.split(".")
    for part in path:
        rig = rig[part]
    if value is None:
        del rig[last]
    else:
        rig[last] = value


def pose(x: float, scale: float = 1.0) -> list[list[float]]:
    return [[scale, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("left.K", None, "left.K"),
        ("T_right_left", pose(-0.1, scale=2.0), "the rotation is not one"),
        ("T_right_left", pose(0.0), "the baseline is zero"),
        ("T_right_left", pose(-94.0), "millimeters it is 0.094 m"),
        ("left.K", [[0, 0, 1], [0, 1, 1], [0, 0, 1]], "focal lengths must be positive"),
    ],
)
def test_bad_calibrations_in_one_line(make_dive, cli, tmp_path, key, value, message) -> None:
    dive = make_dive(1)
    rig = yaml.safe_load((dive.root / "cam.yaml").read_text())
    change(rig, key, value)
    (dive.root / "cam.yaml").write_text(yaml.safe_dump(rig))
    code, printed, said = cli(*dive.command(tmp_path / "out"))
    assert (code, printed) == (1, "")
    assert said.count("\n") == 1
    assert "cam.yaml" in said
    assert message in said


def test_a_suspicious_calibration_is_used_and_named(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    rig = yaml.safe_load((dive.root / "cam.yaml").read_text())
    rig["medium"] = "air"
    (dive.root / "cam.yaml").write_text(yaml.safe_dump(rig))
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 0
    assert "note: calibration: calibrated in air: behind a flat port" in printed


def test_calibration_that_is_no_yaml(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    (dive.root / "cam.yaml").write_text("left: [")
    code, _, said = cli(*dive.command(tmp_path / "out"))
    assert code == 1
    assert "cam.yaml" in said
    assert said.count("\n") == 1


def test_swapped_folders_are_noticed(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    words = ["run", "--left", str(dive.root / "R"), "--right", str(dive.root / "L"), "--calib", str(dive.root / "cam.yaml")]
    code, printed, said = cli(*words, "--out", str(tmp_path / "out"))
    assert code in (1, 3)
    assert "swapped" in printed + said


@pytest.mark.slow
def test_swapped_folders_of_a_rig_that_needs_rectification(cli, tmp_path) -> None:
    reef = Path(__file__).resolve().parents[1] / "data_samples/reef"
    for side, other in (("left", "right"), ("right", "left")):
        (tmp_path / other).mkdir()
        first = min((reef / side).iterdir())
        (tmp_path / other / first.name).symlink_to(first)
    words = ["range", "--left", str(tmp_path / "left"), "--right", str(tmp_path / "right"), "--calib", str(reef / "cam.yaml")]
    code, printed, _ = cli(*words, "--out", str(tmp_path / "out"))
    assert code == 3
    assert re.search(r"^failed: reef_\d+: left and right look swapped: ", printed, re.M)  # its name is there once


def test_twice_the_same_picture(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    words = ["run", "--left", str(dive.root / "L"), "--right", str(dive.root / "L"), "--calib", str(dive.root / "cam.yaml")]
    code, printed, _ = cli(*words, "--out", str(tmp_path / "out"))
    assert code == 3
    assert "are the same picture" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--left", "nowhere"], "nowhere: the folder of left images does not exist"),
        (["--calib", "nowhere.yaml"], "nowhere.yaml"),
        (["--set", "color.lok=survey"], "did you mean 'color.lock'"),
        (["--set", "matching.max_range_m=0.2"], "matching: max_range_m (0.2) must be more than min_range_m (0.3)"),
        (["--config", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["--water", "nowhere.json"], "nowhere.json: cannot be read"),
        (["--fuse", "--poses", "nowhere.tum"], "nowhere.tum: cannot be read"),
    ],
)
def test_what_is_not_there(make_dive, cli, tmp_path, request, words, message) -> None:
    if "--fuse" in words:
        request.getfixturevalue("open3d")
    code, printed, said = cli(*make_dive(1).command(tmp_path / "out"), *words)
    assert (code, printed) == (1, "")
    assert message in said
    assert said.count("\n") == 1


def test_cuda_asked_for_and_absent(make_dive, cli, tmp_path) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    more = ["--set", "color.device=cuda", "--set", "color.method=paper-adam"]
    code, _, said = cli(*make_dive(1).command(tmp_path / "out", *more))
    assert code == 1
    assert "cuda" in said.splitlines()[-1].lower()
    assert said.count("stereo-seecolor: ") == 1


def test_range_map_of_another_size(cli, tmp_path) -> None:
    for folder, content in (("I", np.zeros((9, 9, 3), np.uint8)), ("Z", np.ones((8, 9), np.float32))):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / ("a.png" if folder == "I" else "a.tiff")), content)
    code, printed, _ = cli(
        "correct", "--images", str(tmp_path / "I"), "--range", str(tmp_path / "Z"), "--out", str(tmp_path / "out")
    )
    assert code == 3
    assert "the range map is 9x8 px but its image a.png is 9x9" in printed


def test_wrong_usage(cli) -> None:
    assert cli("run", "--left", "L")[0] == 2
    assert cli("runn")[0] == 2
    assert cli("run", "--left", "L", "--right", "R", "--calib", "c.yaml", "--poses", "p.tum")[0] == 2


@pytest.mark.slow
def test_installed_command_and_version() -> None:
    program = Path(sys.executable).parent / "stereo-seecolor"
    assert subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    help_text = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    assert all(command in help_text for command in ("run", "correct", "range", "rectify", "doctor"))


@pytest.mark.slow
def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys; sys.argv = ['x', '--help']\n"
        "from stereo_seecolor.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print('HEAVY', sorted({'torch', 'numba', 'cv2', 'open3d', 'rasterio', 'scipy'} & sys.modules.keys()))"
    )
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "HEAVY []" in printed


@pytest.mark.slow
def test_demo_shows_how_near_the_truth_it_comes(cli, tmp_path) -> None:
    code, printed, _ = cli("demo", "--out", str(tmp_path / "demo"))
    assert code == 0
    assert "4 pairs done" in printed
    assert "median error" in printed
    assert len(list((tmp_path / "demo/out/corrected").iterdir())) == 4
