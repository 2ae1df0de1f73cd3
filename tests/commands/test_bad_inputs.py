"""Inputs that are wrong in part or as a whole: one line that says what, where, and what to do; the
rest goes on.
"""

import csv
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from conftest import read_pixels
from small_dives import write_short_reef

from calibration import CalibrationError
from calibration.formats import load_rig
from calibration.verification.matches import Matches
from calibration.verification.quick_check import QuickCheck
from stereo_seecolor.checks import rig as rig_checks


def sides_of(folder: Path) -> list[str]:
    """The options that name a short reef (``write_short_reef``)."""
    names = {"--left": "left", "--right": "right", "--calib": "cam.yaml"}
    return [word for option, name in names.items() for word in (option, str(folder / name))]


@pytest.mark.slow
def test_more_lefts_than_rights(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    (dive.root / "R/0001.png").unlink()
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert "L/0001.png: no right image matches" in printed
    assert "2 pairs done, 0 failed, 1 file without a partner" in printed
    rows = {
        row["name"]: row["status"]
        for row in csv.DictReader((tmp_path / "out/frames.csv").read_text().splitlines())
    }
    assert rows == {"0000": "ok", "0001": "unpaired", "0002": "ok"}


@pytest.mark.slow
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
    code, printed, said = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert message in said and message.rpartition(": ")[2] in printed
    assert "2 pairs done, 1 failed" in printed
    assert {path.stem for path in (tmp_path / "out/corrected").iterdir()} == {"0000", "0002"}


def test_strict_stops_at_the_first_bad_pair(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    (dive.root / "R/0001.png").write_bytes(b"")
    code, _, said = cli(*dive.command(tmp_path / "out", "--strict"))
    assert code == 1
    assert "R/0001.png: is empty" in said
    rows = {
        row["name"]: row["status"]
        for row in csv.DictReader((tmp_path / "out/frames.csv").read_text().splitlines())
    }
    assert rows == {"0000": "pending", "0001": "failed", "0002": "pending"}


@pytest.mark.slow
def test_bad_pairs_are_named_at_once_and_counted_at_the_end(make_dive, cli, tmp_path) -> None:
    dive = make_dive(2)
    for i in range(2, 32):
        (dive.root / f"L/{i:04d}.png").write_bytes(bytes(i))
        (dive.root / f"R/{i:04d}.png").write_bytes(b"other")
        (dive.root / f"L/a{i:04d}.png").write_bytes(b"alone")
    code, printed, said = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert said.count("failed: ") == 30
    assert printed.count("failed: ") == 0 and re.search(r"^ 30 +0002 ", printed, re.M)
    assert printed.count("unpaired: ") == 20
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
        ("T_right_left", pose(-0.1, scale=2.0), "R is not a rotation"),
        ("T_right_left", pose(0.0), "the baseline is zero"),
        ("T_right_left", pose(-94.0), "millimeters it is 0.094 m"),
        ("left.K", [[0, 0, 1], [0, 1, 1], [0, 0, 1]], "focal lengths must be positive"),
        ("left.K", [[500, 0, 0], [0, 500, 0], [320, 240, 1]], "K is transposed"),
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


@pytest.mark.slow
def test_a_suspicious_calibration_is_used_and_named(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    rig = yaml.safe_load((dive.root / "cam.yaml").read_text())
    rig["medium"] = "air"
    # as calibrated; of images that were rectified none is left
    rig["left"]["distortion"] = [0.001, 0.0, 0.0, 0.0, 0.0]
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


@pytest.mark.slow
def test_swapped_folders_stop_the_run(make_dive, cli, tmp_path) -> None:
    dive = make_dive()
    words = [
        "run",
        "--left",
        str(dive.root / "R"),
        "--right",
        str(dive.root / "L"),
        "--calib",
        str(dive.root / "cam.yaml"),
    ]
    code, _, said = cli(*words, "--out", str(tmp_path / "out"))
    assert code == 1
    assert re.search(
        r"left and right look swapped: \d+% of \d+ points lie behind .*: exchange --left and "
        r"--right",
        said,
    )
    assert said.count("\n") == 1
    # the refused run wrote nothing, and its folder is free
    assert not (tmp_path / "out").exists()
    assert cli(*dive.command(tmp_path / "out"))[0] == 0


def test_a_calibration_of_another_size_stops_the_run(make_dive, cli, tmp_path) -> None:
    dive = make_dive(2)
    twice = str(tmp_path / "twice.yaml")
    width, height = load_rig(dive.root / "cam.yaml").left.image_size
    assert (
        cli(
            "convert-calib",
            str(dive.root / "cam.yaml"),
            twice,
            "--resize",
            f"{2 * width}x{2 * height}",
        )[0]
        == 0
    )
    words = ["--left", str(dive.root / "L"), "--right", str(dive.root / "R"), "--calib", twice]
    code, _, said = cli("run", *words, "--out", str(tmp_path / "out"))
    assert code == 1
    assert re.search(
        rf"convert-calib {twice} resized.yaml --resize {width}x{height}; if they were cropped", said
    )
    assert said.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("points", [True, False])
def test_swapped_folders_of_a_rig_that_needs_rectification(
    points: bool, cli, tmp_path, monkeypatch
) -> None:
    def too_few(*_: object) -> None:
        raise CalibrationError("only 12 points were found")

    if not points:
        monkeypatch.setattr(
            rig_checks,
            "quick_check",
            lambda *_: QuickCheck(False, Matches(np.zeros((0, 2)), np.zeros((0, 2))), np.zeros(0)),
        )
        monkeypatch.setattr(rig_checks, "judge_matches", too_few)
    reef = Path(__file__).resolve().parents[2] / "data_samples/reef"
    for side, other in (("left", "right"), ("right", "left")):
        (tmp_path / other).mkdir()
        first = min((reef / side).iterdir())
        (tmp_path / other / first.name).symlink_to(first)
        (tmp_path / other / "reef_1780000000000.png").write_bytes(b"cut short")
    words = [
        "range",
        "--left",
        str(tmp_path / "left"),
        "--right",
        str(tmp_path / "right"),
        "--calib",
        str(reef / "cam.yaml"),
    ]
    code, _, said = cli(*words, "--out", str(tmp_path / "out"))
    assert code == 1
    assert "left and right look swapped: " in said
    assert "exchange --left and --right" in said
    assert "1780000000000" not in said  # which cannot be read, so that it was not matched
    assert not (tmp_path / "out/frames.csv").exists()


def test_twice_the_same_picture(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    words = [
        "run",
        "--left",
        str(dive.root / "L"),
        "--calib",
        str(dive.root / "cam.yaml"),
        "--out",
        str(tmp_path / "out"),
    ]
    code, _, said = cli(*words, "--right", str(dive.root / "L"))
    assert code == 1
    assert "give the folder of the other side as --right" in said
    (tmp_path / "twin").symlink_to(dive.root / "L")
    code, _, said = cli(*words, "--right", str(tmp_path / "twin"))
    assert code == 1
    assert "both sides show one camera's image" in said
    assert not (tmp_path / "out" / "frames.csv").exists()


@pytest.mark.slow
def test_a_pair_of_the_same_picture_fails_alone(make_dive, cli, tmp_path) -> None:
    dive = make_dive(3)
    names = [sorted((dive.root / side).iterdir())[1] for side in ("L", "R")]
    names[1].write_bytes(names[0].read_bytes())
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert "is the same image as" in printed and "2 pairs done, 1 failed" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--left", "nowhere"], "nowhere: the folder of left images does not exist"),
        (["--calib", "nowhere.yaml"], "nowhere.yaml"),
        (["--set", "color.lok=survey"], "did you mean 'color.lock'"),
        (
            ["--set", "matching.max_range_m=0.2"],
            "matching: max_range_m (0.2) must be more than min_range_m (0.3)",
        ),
        (["--config", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["--water", "nowhere.json"], "nowhere.json: cannot be read"),
        (["--fuse", "--poses", "nowhere.tum"], "nowhere.tum: cannot be read"),
    ],
)
def test_what_is_not_there(make_dive, cli, tmp_path, words, message) -> None:
    typed = make_dive(1).command(tmp_path / "out")
    if words[0] in typed:
        place = typed.index(words[0])
        del typed[place : place + 2]
    code, printed, said = cli(*typed, *words)
    assert (code, printed) == (1, "")
    assert message in said
    assert sum(not line.startswith("disk: ") for line in said.splitlines()) == 1


def test_cuda_asked_for_and_absent(make_dive, cli, tmp_path) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    more = ["--device", "cuda"]
    code, _, said = cli(*make_dive(1).command(tmp_path / "out", *more))
    assert code == 1
    assert "cuda" in said.splitlines()[-1].lower()
    assert said.count("stereo-seecolor: ") == 1


def test_range_map_of_another_size(cli, tmp_path) -> None:
    for folder, content in (
        ("I", np.zeros((9, 9, 3), np.uint8)),
        ("Z", np.ones((8, 9), np.float32)),
    ):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / ("a.png" if folder == "I" else "a.tiff")), content)
    code, printed, _ = cli(
        "correct",
        "--images",
        str(tmp_path / "I"),
        "--range",
        str(tmp_path / "Z"),
        "--out",
        str(tmp_path / "out"),
    )
    assert code == 3
    assert "the range map is 9x8 px but its image a.png is 9x9: give the range map" in printed
    assert "or resize it (to the nearest pixel) if it shows all of it" in printed


@pytest.mark.slow
def test_a_dive_that_begins_with_black_frames_settles_its_calibration_later(
    make_dive, cli, tmp_path
) -> None:
    """Three pairs of the descent decided how an ambiguous file is read, and the dive was refused
    for them.
    """
    dive = make_dive(5)
    for number in range(3):
        for side in "LR":
            black = dive.root / side / f"{number:04d}.png"
            cv2.imwrite(str(black), np.zeros_like(read_pixels(black)))
    rig = load_rig(dive.root / "cam.yaml")
    lens = np.array([0.001, 0, 0, 0])
    content = {
        "K1": rig.left.K,
        "K2": rig.right.K,
        "D1": lens,
        "D2": lens,
        "R": rig.R,
        "T": rig.T_right_left[:3, 3],
    }
    ambiguous = dive.root / "opencv.json"  # four coefficients: of a pinhole or of a fisheye
    ambiguous.write_text(json.dumps({key: value.tolist() for key, value in content.items()}))
    words = [
        "--left",
        str(dive.root / "L"),
        "--right",
        str(dive.root / "R"),
        "--calib",
        str(ambiguous),
    ]
    code, printed, said = cli("range", *words, "--out", str(tmp_path / "out"))
    assert code == 3
    assert "2 pairs done, 3 failed" in printed
    assert "this reading fits the images" in printed + said


@pytest.mark.slow
def test_an_inverse_transform_stops_the_run(cli, tmp_path) -> None:
    write_short_reef(tmp_path)
    rig = yaml.safe_load((tmp_path / "cam.yaml").read_text())
    rig["T_right_left"] = np.linalg.inv(rig["T_right_left"]).tolist()
    (tmp_path / "cam.yaml").write_text(yaml.safe_dump(rig))
    words = sides_of(tmp_path)
    for command in (
        ["run", *words, "--out", str(tmp_path / "out")],
        ["check", *words, "--pairs", "2", "--refine", str(tmp_path / "new.yaml")],
    ):
        code, _, said = cli(*command)
        assert code == 1
        assert "the inverse one, right to left, in the calibration" in said
        assert said.count("\n") == 1
    assert not (tmp_path / "new.yaml").exists()


@pytest.mark.slow
def test_sides_out_of_step_stop_the_run(cli, tmp_path) -> None:
    write_short_reef(tmp_path, range(0, 6))
    for side, first in (("left", 0), ("right", 1)):
        for number, image in enumerate(sorted((tmp_path / side).iterdir())):
            if first <= number < first + 5:
                image.rename(image.with_name(f"{number - first:04d}.png"))
            else:
                image.unlink()
    words = sides_of(tmp_path)
    code, _, said = cli("run", *words, "--out", str(tmp_path / "out"))
    assert code == 1
    assert re.search(
        r"left and right are 1 image out of synchronization: 000(\d).png fits 000\d.png, not "
        r"000\1.png",
        said,
    )
