"""A side that is out of focus is named, with the blur in pixels, and a map knows of it."""

import csv
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Dive

from stereo_seecolor.checks.blurred_side import blurred_side_notes
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.kept_frames import KeptFrames
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames


@pytest.mark.parametrize(
    ("right_sharpness", "side", "blur"),
    [(0.53, "right", "2.0 px"), (0.8, "right", "1.0 px"), (1 / 0.37, "left", "3.0 px")],
)
def test_the_less_sharp_side_is_named(right_sharpness: float, side: str, blur: str) -> None:
    facts = [{"right_sharpness": right_sharpness}] * 3 + [{"right_sharpness": 1.0}, {}]
    (note,) = blurred_side_notes(facts)
    assert f"the {side} images are less sharp" in note
    assert blur in note


@pytest.mark.parametrize("values", [(), (0.93, 1.07, 0.9), (0.3, 1.0, 1.0)])
def test_sides_in_focus_have_no_note(values: tuple[float, ...]) -> None:
    """A single pair out of focus is no fault of the rig."""
    assert not blurred_side_notes([{"right_sharpness": value} for value in values])


@pytest.mark.slow
def test_a_run_names_the_side_that_is_out_of_focus(
    make_dive: Callable[..., Dive], cli, tmp_path: Path
) -> None:
    dive = make_dive(3)
    for path in (dive.root / "R").iterdir():
        cv2.imwrite(str(path), cv2.GaussianBlur(cv2.imread(str(path)), (0, 0), 2.0))
    code, printed, _ = cli(*dive.command(tmp_path / "out"))
    assert code == 0
    assert "the right images are less sharp than the left ones" in printed
    with (tmp_path / "out" / "frames.csv").open() as file:
        values = [float(row["right_sharpness"]) for row in csv.DictReader(file)]
    assert np.median(values) < 0.7
    frames = SurveyFrames(open_run(tmp_path / "out"))
    kept = KeptFrames(frames, tmp_path / "kept")
    for _ in range(2):  # as they are read from the run, and as they are kept
        less_sharp = FrameIndex.build(kept, frames.geometry).less_sharp
        assert less_sharp == ("right", pytest.approx(np.median(values), rel=1e-4))
