"""A run against known truth: perfect results score perfectly, known faults are found, and the sample dive meets its bar."""

import hashlib
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.commands.evaluate import evaluate
from stereo_seecolor.commands.run import run
from stereo_seecolor.config_file import load_config
from stereo_seecolor.errors import InputError
from stereo_seecolor.evaluation.truth import evaluate_truth
from stereo_seecolor.progress import RunOptions

SAMPLES = Path(__file__).parents[1] / "data_samples" / "reef"
TRUTH = SAMPLES / "truth"
NAMES = sorted(path.stem for path in (TRUTH / "range").glob("*.tiff"))[:2]


@pytest.fixture
def perfect(tmp_path: Path) -> Path:
    """A run folder that holds the truth of two frames."""
    for folder, kept, suffix in (("range", "range", ".tiff"), ("color", "corrected", ".png")):
        (tmp_path / kept).mkdir()
        for name in NAMES:
            shutil.copy(TRUTH / folder / f"{name}{suffix}", tmp_path / kept / f"{name}{suffix}")
    return tmp_path


@pytest.mark.slow
def test_truth_against_itself(perfect: Path) -> None:
    report = evaluate_truth(perfect, TRUTH)
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
    report = evaluate_truth(perfect, TRUTH)
    assert report.range.median_relative_error == pytest.approx(0.02, rel=1e-3)
    assert report.range.bad_1_px < 0.5 < report.range.coverage


@pytest.mark.slow
def test_what_was_filled_in_does_not_count_as_measured(perfect: Path) -> None:
    (perfect / "mask").mkdir()
    filled = np.zeros((448, 576), np.uint8)
    filled[:, 288:] = 2
    for name in NAMES:
        cv2.imwrite(str(perfect / "mask" / f"{name}.png"), filled)
    report = evaluate_truth(perfect, TRUTH)
    assert 0.4 < report.range.coverage < 0.5
    assert report.color.pixels < 0.55 * 448 * 576


@pytest.mark.slow
def test_one_wrong_gain_is_told_from_a_trend(perfect: Path) -> None:
    for name in NAMES:
        path = perfect / "corrected" / f"{name}.png"
        cv2.imwrite(str(path), (cv2.imread(str(path)) * [1.0, 0.9, 0.7]).astype(np.uint8))
    report = evaluate_truth(perfect, TRUTH)
    assert report.color.angle_deg > 5.0
    assert report.color.angle_after_gains_deg < 0.5


def test_folders_that_hold_nothing_to_compare(perfect: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no range/\*\.tiff"):
        evaluate_truth(perfect, perfect / "corrected")
    with pytest.raises(InputError, match="holds no result for any of the 12 frames"):
        evaluate_truth(SAMPLES, TRUTH)
    cv2.imwrite(str(perfect / "range" / f"{NAMES[0]}.tiff"), np.ones((10, 20), np.float32))
    with pytest.raises(InputError, match="is 20x10 pixels, but its truth is 576x448"):
        evaluate_truth(perfect, TRUTH)


def write_run(out: Path, files: dict[str, dict[str, str]], **changed: float) -> None:
    """A run.json as run writes it for the sample dive, with other numbers in its geometry if asked for."""
    geometry = asdict(Rectification.from_rig(load_rig(SAMPLES / "cam.yaml")).pair) | changed
    (out / "run.json").write_text(json.dumps({"geometry": geometry, "inputs": {"files": files}}))


def test_a_run_is_compared_with_the_truth_of_its_own_dive_only(perfect: Path) -> None:
    hashes = {name: {"left": hashlib.sha256((SAMPLES / "left" / f"{name}.png").read_bytes()).hexdigest()} for name in NAMES}
    write_run(perfect, hashes)
    assert evaluate(perfect, TRUTH).color.ciede2000 == pytest.approx(0.0, abs=1e-6)
    write_run(perfect, hashes | {NAMES[1]: hashes[NAMES[0]]})
    with pytest.raises(InputError, match=f"made from other images .*{NAMES[1]}.png is not the image {NAMES[1]} of the run"):
        evaluate(perfect, TRUTH)
    write_run(perfect, hashes, baseline_m=0.2)
    with pytest.raises(InputError, match=r"made with another calibration .* its baseline_m is 0\.2, not "):
        evaluate(perfect, TRUTH)


def test_a_damaged_run_is_not_compared(perfect: Path) -> None:
    (perfect / "run.json").write_text("{")
    with pytest.raises(InputError, match=r"run\.json: cannot be read"):
        evaluate(perfect, TRUTH)


@pytest.mark.slow
def test_sample_dive_meets_its_bar(tmp_path: Path) -> None:
    run(SAMPLES / "left", SAMPLES / "right", str(SAMPLES / "cam.yaml"), tmp_path / "out", load_config(), RunOptions())
    report = evaluate_truth(tmp_path / "out", TRUTH)
    assert not report.missing
    assert report.range.median_relative_error < 0.005
    assert report.range.coverage > 0.97
    assert report.color.angle_deg < 0.5 * report.raw_color.angle_deg
    assert report.color.ciede2000 < 0.5 * report.raw_color.ciede2000
