"""A camera that stalls, and gives its image twice, is named."""

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
from conftest import Dive


@pytest.mark.parametrize("stalled", ["LR", "L", "R"])
def test_images_that_come_twice_are_named(make_dive: Callable[..., Dive], cli, tmp_path: Path, stalled: str) -> None:
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
    named = {"LR": "both images are those", "L": "the left image is that", "R": "the right image is that"}[stalled]
    assert [f"{named} of the pair before" in text for text in warnings] == [False, False, True]
