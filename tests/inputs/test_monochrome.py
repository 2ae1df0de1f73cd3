"""Rigs with a monochrome camera on one side, or on both."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames


def make_gray(folder: Path) -> None:
    """Keep the green channel, as a file of one channel."""
    for path in folder.iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path))[..., 1])


def corrected(out: Path, suffix: str) -> np.ndarray:
    image = cv2.imread(str(out / "corrected" / f"0001{suffix}"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image


@pytest.mark.slow
@pytest.mark.parametrize(
    ("image_format", "suffix"),
    [("png", ".png"), ("png16", ".png"), ("jpg", ".jpg"), ("tiff32", ".tiff")],
)
def test_two_monochrome_cameras_give_one_channel(
    make_dive, tmp_path: Path, image_format: str, suffix: str
) -> None:
    dive = make_dive(2)
    for side in "LR":
        make_gray(dive.root / side)
    config = load_config(None, [f"output.image_format={image_format}"])
    summary = run(
        dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out", config
    )
    assert summary.count("ok") == 2
    assert corrected(tmp_path / "out", suffix).ndim == 2
    frame = SurveyFrames(open_run(tmp_path / "out"))[1]
    assert frame.color.shape == (*dive.range_m.shape, 3)
    np.testing.assert_array_equal(frame.color[..., 0], frame.color[..., 2])


@pytest.mark.slow
def test_color_with_monochrome_matches_and_stays_in_color(make_dive, tmp_path: Path) -> None:
    dive = make_dive(2)
    make_gray(dive.root / "R")
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert summary.count("ok") == 2
    assert summary.rows[0].facts["coverage"] > 0.5
    assert corrected(tmp_path / "out", ".png").ndim == 3


@pytest.mark.slow
def test_a_monochrome_camera_sees_less_water_in_what_is_corrected(
    make_dive, tmp_path: Path
) -> None:
    """Far and near halves of one texture differ in contrast by attenuation; corrected, they differ
    less.
    """
    dive = make_dive(2)
    for side in "LR":
        make_gray(dive.root / side)
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    raw, now = (
        cv2.imread(str(dive.root / "L" / "0001.png"), cv2.IMREAD_UNCHANGED),
        corrected(tmp_path / "out", ".png"),
    )
    known = now > 0

    def contrast_ratio(image: np.ndarray) -> float:
        far, near = np.split(np.arange(image.shape[0]), 2)
        return float(np.std(image[near][known[near]]) / np.std(image[far][known[far]]))

    assert abs(contrast_ratio(now) - 1) < abs(contrast_ratio(raw) - 1)
