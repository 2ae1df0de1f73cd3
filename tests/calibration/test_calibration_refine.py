"""Refining a rig with matches of a dive: what has moved comes back with honest errors, and nothing
moves by chance.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calibration_boards import fisheye_rig, mismatched, pinhole_rig, seen_by
from scipy.optimize import least_squares
from test_calibration_port import port_rig
from test_calibration_rectification import rig_at

from calibration import CalibrationError, Camera, StereoRig
from calibration.checks import vertical_disparity
from calibration.formats import load_rig
from calibration.refine import PARAMETERS, moved_rig, refine_matches
from calibration.verification.matches import Matches
from stereo_seecolor.checks.sample import read_both
from stereo_seecolor.commands.rig_refinement import refine_rig
from stereo_seecolor.config import InputConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.inputs.dive_pairs import pair_sides

RIGS = {
    "pinhole": pinhole_rig(),
    "fisheye": fisheye_rig(),
    "flat port": port_rig(),
    "vertical": rig_at(91.0),
}


def dive(truth: StereoRig, pairs: int = 8, noise_px: float = 0.1) -> list[Matches]:
    """Raw matches of points 0.6 to 4 m before the rig; a tenth of them mismatched, and each pair
    with an error of its own.
    """
    rng = np.random.default_rng(3)
    found = []
    for _ in range(pairs):
        left, right = seen_by(truth, 500, noise_px, rng)
        right = right + rng.normal(0, 0.03, 2)
        found.append(Matches(left, mismatched(right, rng)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_what_has_moved_comes_back(name: str) -> None:
    calibrated = RIGS[name]
    values = np.array([0.002, -0.003, 0.004, 0.0])
    rig = refine_matches(calibrated, dive(moved_rig(calibrated, values)))
    found = rig.refinement
    assert found
    assert found.after_px < 0.15 < 0.5 < found.before_px
    assert [movement.name for movement in found.movements] == list(PARAMETERS)
    for movement, value in zip(found.movements, values, strict=True):
        assert movement.value == pytest.approx(value, abs=max(5 * movement.std, 2e-5))
        assert movement.std < 4e-4
    assert rig.baseline_m == pytest.approx(calibrated.baseline_m)


@pytest.mark.slow
def test_what_has_not_moved_stays_within_its_error() -> None:
    calibrated = pinhole_rig()
    found = refine_matches(
        calibrated, dive(moved_rig(calibrated, np.array([0.001, 0, 0, 0])))
    ).refinement
    assert found
    for movement in found.movements[1:]:
        assert abs(movement.value) < 2 * movement.std
    text = "\n".join(found.lines())
    assert "a vertical offset of +1." in text
    assert "not visible in vertical disparity: the length of the baseline" in text


@pytest.mark.slow
def test_standard_errors_hold_what_the_lens_model_has_wrong() -> None:
    """All pairs have it at the same place: with pairs left out alone, values were 12 standard
    errors off.
    """
    calibrated, off = pinhole_rig(), []
    for k1, p1 in ((0.0015, 0.0), (-0.0015, 0.0), (0.0, 0.0003), (0.0, -0.0003)):
        distortion = calibrated.right.distortion + np.array([k1, 0, p1, 0, 0])
        truth = replace(calibrated, right=replace(calibrated.right, distortion=distortion))
        found = refine_matches(calibrated, dive(truth)).refinement
        assert found
        off += [movement.value / movement.std for movement in found.movements]
    assert np.sqrt(np.mean(np.square(off))) < 2.5


@pytest.mark.slow
def test_yaw_comes_with_a_warning() -> None:
    calibrated = pinhole_rig()
    found = refine_matches(
        calibrated, dive(moved_rig(calibrated, np.array([0.001, 0.001, 0.001, 0.02])))
    ).refinement
    assert found
    assert found.movements[-1].name == "yaw"
    assert found.movements[-1].value == pytest.approx(0.02, abs=0.002)
    assert "yaw shifts every disparity" in "\n".join(found.lines())


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_a_rig_that_fits_moves_within_its_errors(name: str) -> None:
    calibrated = RIGS[name]
    found = refine_matches(calibrated, dive(calibrated)).refinement
    assert found and found.movements
    for movement in found.movements:
        assert abs(movement.value) < 2.5 * movement.std < 2e-3


@pytest.mark.slow
def test_a_calibration_that_pairs_left_out_agree_better_with_is_left_as_it_is() -> None:
    """Each pair is off by an error of its own, and none tells of another's."""
    calibrated, rng = pinhole_rig(), np.random.default_rng(1)
    pairs = []
    for off_px in (0.5, -0.5, 0.5, -0.5):
        left, right = seen_by(calibrated, 500, 0.1, rng)
        pairs.append(Matches(left, right + np.array([0, off_px])))
    rig = refine_matches(calibrated, pairs)
    assert rig.right is calibrated.right and np.array_equal(
        rig.T_right_left, calibrated.T_right_left
    )
    found = rig.refinement
    assert found and found.movements == () and found.slope_std == (0, 0)
    assert "used unchanged" in found.lines()[1]


@pytest.mark.slow
def test_a_calibration_made_in_air_is_not_refined() -> None:
    """Yaw and scale together would hide it, with ranges wrong by a quarter."""
    rig = port_rig(0.02, toe_in=0.03)
    with pytest.raises(CalibrationError, match=r"made in air.*with a wrong yaw"):
        refine_matches(replace(rig, port=None), dive(rig))


def in_air(camera: Camera, index: float = 1.34) -> Camera:
    """The calibration in air of a camera behind a flat window on its center, whose calibration in
    water is ``camera``.
    """
    u, v = np.meshgrid(*(np.linspace(0, size - 1, 21) for size in camera.image_size))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    in_water = camera.rays(pixels)
    sines = in_water[:, :2] / np.linalg.norm(in_water, axis=1, keepdims=True) * index
    points = np.column_stack(
        [sines / np.sqrt(1 - (sines**2).sum(axis=1))[:, None], np.ones(len(sines))]
    )
    K = camera.K / [[index], [index], [1]]
    K[:2, 2] = camera.K[:2, 2]

    def fitted(distortion: np.ndarray) -> Camera:
        return Camera(K, distortion, camera.image_size)

    start = np.zeros(5)
    return fitted(
        least_squares(lambda d: (fitted(d).project(points) - pixels).ravel(), start, x_scale=0.1).x
    )


def test_too_few_pairs() -> None:
    calibrated = pinhole_rig()
    with pytest.raises(CalibrationError, match="2 of 3 pairs"):
        refine_matches(
            calibrated, [*dive(calibrated, 2), Matches(np.zeros((0, 2)), np.zeros((0, 2)))]
        )


@pytest.mark.slow
@pytest.mark.real_data
def test_a_real_rig_that_has_drifted(real_data: Path) -> None:
    """The reef dive: 0.6 px as published, under 0.15 px on pairs that took no part. The rows of
    these ten pairs alone fit an enlarged image and another lens, too, which the motion excludes.
    """
    calibrated = load_rig(real_data / "acfr" / "stereo_calib.mat", (1360, 1024))
    images = InputConfig()
    pairs = pair_sides(real_data / "acfr" / "left", real_data / "acfr" / "right", images).pairs
    rig = refine_rig(calibrated, pairs[6:16:2], pairs[6:16], images, RunOptions())
    found = rig.refinement
    assert found and 0.4 < found.before_px < 0.8
    assert found.after_px < 0.15
    others = [read_both(pair, images) for pair in pairs[2:20:16]]
    check = vertical_disparity(rig, others)
    assert check.row_error_px < 0.15 and not check.air_in_water
    left, right = (in_air(camera) for camera in (rig.left, rig.right))
    air = vertical_disparity(replace(rig, left=left, right=right), others)
    assert air.air_in_water
    index = re.search(r"a flat port \(index (\S+) \+- (\S+)\)", air.advice[0])
    assert index and float(index[2]) < 0.035
    assert abs(float(index[1]) - 1.34) < 2 * float(index[2])
