"""A run against known truth: perfect results score perfectly, known faults are found, and the
sample dive meets its bar.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import SampleRun

from calibration.formats import load_rig, native
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.evaluate_run import evaluate
from stereo_seecolor.extras.evaluation.truth import ResultFiles, evaluate_truth

SAMPLES = Path(__file__).parents[3] / "data_samples" / "reef"
TRUTH = SAMPLES / "truth"
NAMES = sorted(path.stem for path in (TRUTH / "range").glob("*.tiff"))[:2]


@pytest.fixture
def perfect(tmp_path: Path) -> Path:
    """A folder of results that holds the truth of two frames."""
    for folder, kept, suffix in (("range", "range", ".tiff"), ("color", "corrected", ".png")):
        (tmp_path / kept).mkdir()
        for name in NAMES:
            shutil.copy(TRUTH / folder / f"{name}{suffix}", tmp_path / kept / f"{name}{suffix}")
    return tmp_path


def files_of(folder: Path) -> dict[str, ResultFiles]:
    """The two frames of such a folder, with their masks where it has any."""
    mask = folder / "mask"
    return {
        name: ResultFiles(
            folder / "range" / f"{name}.tiff",
            folder / "corrected" / f"{name}.png",
            mask / f"{name}.png" if mask.is_dir() else None,
        )
        for name in NAMES
    }


@pytest.mark.slow
def test_truth_against_itself(perfect: Path) -> None:
    report = evaluate_truth(files_of(perfect), TRUTH)
    assert report.range.median_relative_error == 0.0
    assert report.range.bad_1_px == report.range.bad_2_px == 0.0
    assert report.range.coverage == 1.0
    assert report.color.angle_deg == pytest.approx(0.0, abs=1e-6)
    assert report.color.ciede2000 == pytest.approx(0.0, abs=1e-6)
    assert report.color.range_consistency == pytest.approx(1.0)
    assert report.raw_color.angle_deg > 10.0
    assert report.color.pixels == report.raw_color.pixels > 100_000
    assert len(report.frames) == 2
    assert len(report.missing) == 10


@pytest.mark.slow
def test_ranges_two_percent_too_long(perfect: Path) -> None:
    for name in NAMES:
        path = perfect / "range" / f"{name}.tiff"
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * np.float32(1.02))
    report = evaluate_truth(files_of(perfect), TRUTH)
    assert report.range.median_relative_error == pytest.approx(0.02, rel=1e-3)
    assert report.range.bad_1_px < 0.5 < report.range.coverage


@pytest.mark.slow
def test_what_was_filled_in_does_not_count_as_measured(perfect: Path) -> None:
    (perfect / "mask").mkdir()
    filled = np.zeros((448, 576), np.uint8)
    filled[:, 288:] = 2
    for name in NAMES:
        cv2.imwrite(str(perfect / "mask" / f"{name}.png"), filled)
    report = evaluate_truth(files_of(perfect), TRUTH)
    assert 0.4 < report.range.coverage < 0.5
    assert report.color.pixels < 0.55 * 448 * 576


@pytest.mark.slow
def test_one_wrong_gain_is_told_from_a_trend(perfect: Path) -> None:
    for name in NAMES:
        path = perfect / "corrected" / f"{name}.png"
        cv2.imwrite(str(path), (cv2.imread(str(path)) * [1.0, 0.9, 0.7]).astype(np.uint8))
    report = evaluate_truth(files_of(perfect), TRUTH)
    assert report.color.angle_deg > 5.0
    assert report.color.angle_after_gains_deg < 0.5


def test_folders_that_hold_nothing_to_compare(perfect: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no range/\*\.tiff"):
        evaluate_truth(files_of(perfect), perfect / "corrected")
    with pytest.raises(InputError, match="no result for any of the 12 frames"):
        evaluate_truth({}, TRUTH)
    cv2.imwrite(str(perfect / "range" / f"{NAMES[0]}.tiff"), np.ones((10, 20), np.float32))
    with pytest.raises(InputError, match="is 20x10 pixels, but its truth is 576x448"):
        evaluate_truth(files_of(perfect), TRUTH)


@pytest.fixture
def small_dive(tmp_path: Path) -> Path:
    """Two frames of the sample dive, with their truth, as a dive of their own."""
    dive = tmp_path / "dive"
    dive.mkdir()
    for side in ("left", "right"):
        (dive / side).mkdir()
        for name in NAMES:
            shutil.copy(SAMPLES / side / f"{name}.png", dive / side)
    shutil.copy(SAMPLES / "cam.yaml", dive)
    (dive / "truth").symlink_to(TRUTH)
    return dive


@pytest.mark.slow
def test_a_run_is_compared_with_the_truth_of_its_own_dive_only(
    small_dive: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    config = load_config(overrides=["output.preset=no-clouds"])
    run(small_dive / "left", small_dive / "right", small_dive / "cam.yaml", out, config)
    report = evaluate(out, small_dive / "truth")
    assert [frame.name for frame in report.frames] == NAMES
    assert report.range.coverage > 0.9

    with pytest.raises(InputError, match=r"nowhere: holds no range/\*\.tiff"):
        evaluate(out, tmp_path / "nowhere")

    rig = (small_dive / "cam.yaml").read_text()
    native.write(
        replace(load_rig(SAMPLES / "cam.yaml"), T_right_left=shifted(1.25)), small_dive / "cam.yaml"
    )
    with pytest.raises(
        InputError, match=r"made with another calibration .* its baseline_m is .*, not "
    ):
        evaluate(out, small_dive / "truth")
    (small_dive / "cam.yaml").write_text(rig)

    first, second = (small_dive / "left" / f"{name}.png" for name in NAMES)
    shutil.copy(first, second)
    with pytest.raises(
        InputError,
        match=f"made from other images .*{NAMES[1]}.png is not the image {NAMES[1]} of the run",
    ):
        evaluate(out, small_dive / "truth")


def shifted(factor: float) -> np.ndarray:
    """The sample rig's transform with a baseline longer by that factor."""
    T = load_rig(SAMPLES / "cam.yaml").T_right_left.copy()
    T[:3, 3] *= factor
    return T


@pytest.mark.slow
def test_sample_dive_meets_its_bar(sample_run: SampleRun) -> None:
    report = evaluate(sample_run.out, TRUTH)
    assert not report.missing
    assert report.range.median_relative_error < 0.005
    assert report.range.coverage > 0.97
    assert report.color.angle_deg < 0.5 * report.raw_color.angle_deg
    assert report.color.ciede2000 < 0.5 * report.raw_color.ciede2000
