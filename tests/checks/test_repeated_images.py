"""A camera that stalls, and gives its image twice, is named."""

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
from conftest import Dive
from small_dives import write_short_reef


@pytest.mark.slow
@pytest.mark.parametrize("stalled", ["LR", "L", "R"])
def test_images_that_come_twice_are_named(
    make_dive: Callable[..., Dive], cli, tmp_path: Path, stalled: str
) -> None:
    dive = make_dive(3)
    for side in "LR":
        again = dive.root / side / "0002.png"
        shutil.copy(dive.root / side / "0001.png", again)
        if side not in stalled:
            cv2.imwrite(str(again), cv2.imread(str(again)), [cv2.IMWRITE_PNG_COMPRESSION, 9])

    out = tmp_path / "out"
    code, _, _ = cli(*dive.command(out, "--set", "color.lock=survey"))

    assert code == 0
    with (out / "frames.csv").open() as file:
        warnings = [row["warnings"] for row in csv.DictReader(file)]
    named = {
        "LR": "both images are those",
        "L": "the left image is that",
        "R": "the right image is that",
    }[stalled]
    assert [f"{named} of the previous pair" in text for text in warnings] == [False, False, True]


@pytest.mark.slow
def test_frames_of_a_stalled_camera_are_left_out_of_track_and_map(cli, tmp_path: Path) -> None:
    """At the third and fourth of seven."""
    write_short_reef(tmp_path, range(7))
    for side in ("left", "right"):
        images = sorted((tmp_path / side).iterdir())
        for number in (2, 3):
            shutil.copy(images[1], images[number])
    words = [f"--left={tmp_path / 'left'}", f"--right={tmp_path / 'right'}"]
    words.append(f"--calib={tmp_path / 'cam.yaml'}")
    code, printed, _ = cli("run", *words, "--out", tmp_path / "out", "--fuse")
    assert code == 0
    assert "2 frames with an image of the previous frame, the first: reef_1790000002000" in printed
    with (tmp_path / "out" / "map" / "poses.csv").open() as file:
        placed = [row["name"] for row in csv.DictReader(file)]
    assert placed == [images[number].stem for number in (0, 1, 4, 5, 6)]
