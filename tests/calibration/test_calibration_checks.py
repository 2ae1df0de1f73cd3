"""Checks of a calibration: each names what is wrong with its evidence, and none cries wolf over a
good one.
"""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_boards import fisheye_rig, mismatched, pinhole_rig, seen_by
from test_calibration_port import port_rig

from calibration import CalibrationError, Camera, Rectification, StereoRig
from calibration.checks import RowCheck, judge_matches, vertical_disparity
from calibration.formats import load_rig
from calibration.rectification import plan_rectification, rectified_points
from calibration.refine import moved_rig
from calibration.suspicions import lens_folds, suspicions
from calibration.verification.matches import Matches, MatchLimits, find_matches
from calibration.verification.quick_check import quick_check
from calibration.verification.table import CUT_OUT

REEF = Path(__file__).resolve().parents[2] / "data_samples" / "reef"
GOOD = [pinhole_rig(), fisheye_rig(), port_rig()]


def matches_of(
    truth: StereoRig, seen_as: StereoRig, noise_px: float = 0.1, seed: int = 0
) -> Matches:
    """Random points 0.6 to 4 m before the rig, a tenth of them mismatched, as rectified with
    ``seen_as``.
    """
    rng = np.random.default_rng(seed)
    left, right = seen_by(truth, 600, noise_px, rng)
    return Matches(*rectified_points(seen_as, left, mismatched(right, rng)))


@pytest.mark.parametrize("rig", GOOD, ids=["pinhole", "fisheye", "port"])
def test_good_rig_is_beyond_suspicion(rig: StereoRig) -> None:
    assert suspicions(rig) == ()
    check = judge_matches(rig, [matches_of(rig, rig)])
    assert check.acceptable
    assert check.advice == ()
    assert check.row_error_px == pytest.approx(0.1, abs=0.04)


@pytest.mark.slow
@pytest.mark.parametrize("toe_in", [0.0, 0.03, -0.05])
def test_air_calibration_in_water_is_told_by_the_images(toe_in: float) -> None:
    rig = port_rig(0.02, toe_in=toe_in)
    check = judge_matches(replace(rig, port=None), [matches_of(rig, replace(rig, port=None))])
    assert check.air_in_water
    index = re.search(r"a flat port \(index (\S+) \+-", check.advice[0])
    assert index and float(index[1]) == pytest.approx(1.34, abs=0.05)
    assert "made in air" in check.advice[0] and "--set input.flat_port=30mm:10mm" in check.advice[0]


def enlarged(rig: StereoRig, factor: float) -> StereoRig:
    """The rig of images of which the middle was enlarged by a factor, to the size that they had."""
    assert CUT_OUT.make
    return CUT_OUT.make(rig, factor - 1)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.25, 1.5, 2.0])
def test_images_cut_out_and_enlarged_are_told_by_the_lens(factor: float) -> None:
    rig = pinhole_rig()
    check = judge_matches(rig, [matches_of(enlarged(rig, factor), rig)])
    assert check.cut_out and not check.has_moved and not check.air_in_water
    said = re.search(r"of both sides cropped and enlarged (\S+) \+-", check.advice[0])
    assert said and float(said[1]) == pytest.approx(factor, rel=0.02)


@pytest.mark.slow
def test_a_small_cut_that_looks_like_a_moved_camera_is_said_with_what_it_does_to_ranges() -> None:
    """A lens that is mounted higher than the other is so by more in the enlarged images: an offset
    of the rows.
    """
    rig = pinhole_rig()
    check = judge_matches(rig, [matches_of(enlarged(rig, 1.03), rig)])
    assert check.causes.best and check.causes.best.range_error == pytest.approx(-0.03, abs=0.015)
    assert "cropped and enlarged 1.03" in check.advice[0]
    rolled = judge_matches(rig, [matches_of(moved_rig(rig, np.array([0, 0.003, 0, 0])), rig)])
    assert "a camera has moved since; calibrate again" in rolled.advice[0]


@pytest.mark.slow
def test_rectified_images_given_with_the_raw_calibration_are_named() -> None:
    rig = pinhole_rig()
    rectified = Rectification.from_rig(rig).rectified_rig()
    # the mixture: rectified lenses, and the raw cameras' rotation
    turned = replace(rectified, T_right_left=rig.T_right_left)
    for given in (
        rig,
        turned,
        replace(rig, left=replace(rig.left, distortion=-rig.left.distortion)),
    ):
        check = judge_matches(given, [matches_of(rectified, given)])
        assert check.rectified_already and not check.acceptable
        assert not (check.has_moved or check.air_in_water or check.cut_out)
        assert (
            check.advice[0].startswith("the images are rectified already: ")
            and "or the raw images" in check.advice[0]
        )
    for truth, given in (
        (rig, rig),
        (rectified, rectified),
        (moved_rig(rig, np.array([0.003, 0, 0, 0])), rig),
    ):
        assert not judge_matches(given, [matches_of(truth, given)]).rectified_already


@pytest.mark.slow
@pytest.mark.parametrize("lower_px", [0.0, 1.0])
def test_one_camera_on_both_sides_is_named(lower_px: float) -> None:
    """Also of a rig whose rectification moves both images alike, or apart."""
    for rig in (pinhole_rig(), Rectification.from_rig(pinhole_rig()).rectified_rig()):
        left, _ = seen_by(rig, 400, 0.1, np.random.default_rng(0))
        check = judge_matches(
            rig, [Matches(*rectified_points(rig, left, left + np.array([0, lower_px])))]
        )
        assert check.one_picture and not check.acceptable and not check.has_moved
        assert check.advice[0].startswith("both sides show one camera's image")


@pytest.mark.slow
def test_pairs_of_a_moving_camera_are_no_rig_that_has_moved() -> None:
    rig, rng = pinhole_rig(), np.random.default_rng(5)
    poses = [rng.normal(0, 0.006, 4) for _ in range(6)]
    check = judge_matches(
        rig, [matches_of(moved_rig(rig, pose), rig, seed=i) for i, pose in enumerate(poses)]
    )
    assert check.no_rig and not check.has_moved
    assert "as do images of one moving camera" in check.advice[0]
    drifted = [matches_of(moved_rig(rig, poses[0]), rig, seed=seed) for seed in range(6)]
    assert not judge_matches(rig, drifted).no_rig


@pytest.mark.slow
def test_camera_turned_since_is_explained() -> None:
    rig = pinhole_rig()
    turn = np.eye(4)
    turn[:3, :3] = cv2.Rodrigues(np.array([0.002, 0.0, 0.004]))[0]
    check = judge_matches(
        rig, [matches_of(replace(rig, T_right_left=turn @ rig.T_right_left), rig)]
    )
    assert not check.acceptable and not check.air_in_water and not check.cut_out
    assert check.offset_px == pytest.approx(-0.002 * 1100, abs=0.5)
    assert check.roll_deg == pytest.approx(np.degrees(0.004), abs=0.05)
    assert "a camera has moved since" in check.advice[0]


def three(truth: StereoRig, seen_as: StereoRig) -> list[Matches]:
    return [matches_of(truth, seen_as, seed=seed) for seed in range(3)]


@pytest.mark.slow
@pytest.mark.parametrize("rig", GOOD, ids=["pinhole", "fisheye", "port"])
def test_a_yaw_is_named_with_its_error_of_ranges(rig: StereoRig) -> None:
    assert not judge_matches(rig, three(rig, rig)).causes.is_wrong
    turned = moved_rig(rig, np.array([0, 0, 0, 0.006]))
    check = judge_matches(rig, three(turned, rig))
    found = check.causes.best
    assert found and not check.is_lens and check.has_moved and not check.acceptable
    yaw_deg, std_deg = map(
        float, re.search(r"\(yaw\) by (\S+) \+- (\S+) degrees", check.advice[0]).groups()
    )
    assert abs(yaw_deg) == pytest.approx(np.degrees(0.006), abs=2 * std_deg)
    assert found.range_error == pytest.approx(range_error(turned, rig), abs=2 * found.range_std)


def range_error(truth: StereoRig, seen_as: StereoRig) -> float:
    """Median over points that both rigs see."""
    raw = seen_by(truth, 600, 0.0, np.random.default_rng(0))
    disparities_px = []
    for rig in (truth, seen_as):
        left, right = rectified_points(rig, *raw)
        pair = plan_rectification(rig).matching_pair
        disparities_px.append((left - right)[:, 0] - (pair.cx_left_px - pair.cx_right_px))
    return float(np.median(disparities_px[0] / disparities_px[1]) - 1)


@pytest.mark.slow
def test_lenses_without_their_distortion_are_no_camera_that_has_moved() -> None:
    rig = pinhole_rig()
    left, right = (replace(camera, distortion=np.zeros(5)) for camera in (rig.left, rig.right))
    straight = replace(rig, left=left, right=right)
    check = judge_matches(straight, three(rig, straight))
    assert not check.acceptable and not check.has_moved and not check.air_in_water
    assert "no lens distortion" in "; ".join(suspicions(straight))


@pytest.mark.slow
def test_other_zoom_is_a_vertical_scale() -> None:
    rig = pinhole_rig()
    zoomed = rig.right.K.copy()
    zoomed[:2, :2] *= 1.01
    check = judge_matches(rig, [matches_of(replace(rig, right=replace(rig.right, K=zoomed)), rig)])
    assert check.scale == pytest.approx(1.01, abs=0.002)


def test_swapped_folders_are_told() -> None:
    rig = pinhole_rig()
    matches = matches_of(rig, rig)
    check = judge_matches(rig, [Matches(matches.right, matches.left)])
    assert check.swapped and not check.acceptable
    assert re.search("exchanged.* rotated by 180 degrees or mirrored", check.advice[0])


def test_too_few_points_say_so() -> None:
    with pytest.raises(CalibrationError, match="only 0 points"):
        judge_matches(pinhole_rig(), [Matches(np.zeros((0, 2)), np.zeros((0, 2)))])


def test_images_of_another_size_are_refused() -> None:
    small = np.zeros((480, 640), np.uint8)
    with pytest.raises(CalibrationError, match="640x480 px but the calibration is for 1280x960"):
        vertical_disparity(pinhole_rig(), [(small, small)])


@pytest.mark.slow
def test_flat_pictures_hold_no_matches() -> None:
    gray = np.full((960, 1280, 3), 90, np.uint16)
    with pytest.raises(CalibrationError, match="only 0 points"):
        vertical_disparity(pinhole_rig(), [(gray, gray)])


def _changed(**camera: object) -> StereoRig:
    rig = pinhole_rig()
    return replace(rig, left=replace(rig.left, **camera))  # type: ignore[arg-type]


K = pinhole_rig().left.K
SUSPECT = {
    "another resolution": (
        _changed(K=K * [[0.5], [0.5], [1]]),
        "or to larger images that these are cut out of (about 652x470)",
    ),
    "counted from the center": (
        _changed(K=K - [[0, 0, 640], [0, 0, 480], [0, 0, 0]]),
        "it seems to be counted from the center: add half of the width and height",
    ),
    "not square": (_changed(K=K * [[1.2], [1], [1]]), "pixels are usually square"),
    "focal length": (
        _changed(K=K * [[0.1, 1, 1], [1, 0.1, 1], [1, 1, 1]]),
        "focal length of 110 px",
    ),
    "fold": (
        _changed(distortion=np.array([-0.9, 0.0, 0, 0, 0])),
        "is not monotonic up to the image corners",
    ),
    "rms": (replace(pinhole_rig(), rms_px=2.5), "reprojection error of the calibration is 2.50 px"),
    "air": (replace(pinhole_rig(), medium="air"), "calibrated in air"),
}


@pytest.mark.parametrize("case", SUSPECT)
def test_suspicious_rig(case: str) -> None:
    rig, message = SUSPECT[case]
    assert message in "; ".join(suspicions(rig))


@pytest.mark.parametrize("fraction", [0.5, 0.7, 0.8, 0.95, 1.1])
def test_a_quotient_whose_denominator_vanishes_in_the_image_is_named(fraction: float) -> None:
    """A lens like the one of five coefficients in the middle, with a pole at a fraction of the
    corner's distance.
    """
    rig = pinhole_rig()
    camera = rig.left
    size = np.array(camera.image_size)
    corners = np.array([[0, 0], size - 1, [0, size[1] - 1], [size[0] - 1, 0]])
    slopes = (corners - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]]
    k4 = -1 / (fraction * float(np.linalg.norm(slopes, axis=1).max())) ** 2
    k1, k2, p1, p2 = camera.distortion[:4]
    quotient = np.array([k1 + k4, k2 + k4 * k1, p1, p2, 0.0, k4, 0.0, 0.0])
    assert lens_folds(replace(camera, distortion=quotient)) == (fraction < 1)


def test_fisheye_of_180_degrees_is_beyond_suspicion() -> None:
    rig = fisheye_rig()
    K = rig.left.K * np.array([[0.7], [0.7], [1]]) + np.array([[0, 0, 192], [0, 0, 144], [0, 0, 0]])
    round_image = replace(rig.left, K=K)
    assert suspicions(replace(rig, left=round_image, right=round_image)) == ()
    turned_back = replace(rig.left, distortion=np.array([-0.5, 0.0, 0.0, 0.0]))
    assert "is not monotonic" in "; ".join(suspicions(replace(rig, left=turned_back)))


def test_cameras_looking_apart() -> None:
    rig = pinhole_rig()
    T = rig.T_right_left.copy()
    T[:3, :3] = cv2.Rodrigues(np.array([0.0, 0.65, 0.0]))[0]
    T[:3, 3] = -T[:3, :3] @ [0.12, 0, 0]
    found = "; ".join(suspicions(replace(rig, T_right_left=T)))
    assert "rotated by 37 degrees" in found
    assert "rectified images keep" in found


def test_cameras_without_a_common_view() -> None:
    rig = pinhole_rig()
    T = rig.T_right_left.copy()
    T[:3, :3] = cv2.Rodrigues(np.array([0.0, 1.5, 0.0]))[0]
    T[:3, 3] = -T[:3, :3] @ [0.12, 0, 0]
    with pytest.raises(CalibrationError, match=r"no field of view|reaches no pixel"):
        Rectification.from_rig(replace(rig, T_right_left=T))


@pytest.mark.slow
def test_a_quick_look_tells_rows_that_agree_from_shifted_and_swapped_ones() -> None:
    left, right = (
        cv2.imread(str(sorted((REEF / side).iterdir())[0])) for side in ("left", "right")
    )
    rectification = Rectification.from_rig(load_rig(REEF / "cam.yaml"))
    look = quick_check(rectification, (left, right))
    assert look.rows_agree
    assert 1.2 < np.median(look.range_m) < 3
    assert not quick_check(rectification, (left, np.roll(right, 1, axis=0))).rows_agree
    assert not quick_check(rectification, (right, left)).rows_agree
    nothing = quick_check(rectification, (left, np.full_like(right, 90)))
    assert not nothing.rows_agree
    assert nothing.range_m.size == 0


@pytest.mark.slow
def test_images_of_many_pixels_are_matched_at_a_coarser_step_and_as_exactly() -> None:
    left, right = (
        cv2.imread(str(sorted((REEF / side).iterdir())[0])) for side in ("left", "right")
    )
    rig = load_rig(REEF / "cam.yaml")
    found = find_matches(
        Rectification.from_rig(rig),
        left,
        right,
        MatchLimits(most_pixels=left.shape[0] * left.shape[1] / 3),
    )
    rows = judge_matches(rig, [found])
    assert rows.matches > 200
    assert rows.row_error_px < 0.1
    assert abs(rows.offset_px) < 0.05


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize("name", ["aloe", "teddy"])
def test_rectified_real_pair_is_acceptable_and_a_shift_is_measured(
    name: str, real_data: Path
) -> None:
    left, right = (cv2.imread(str(real_data / name / f"{side}.png")) for side in ("left", "right"))
    height, width = left.shape[:2]
    camera = Camera(
        np.array([[1.2 * width, 0, width / 2], [0, 1.2 * width, height / 2], [0, 0, 1]]),
        np.zeros(0),
        (width, height),
    )
    T = np.eye(4)
    T[0, 3] = -0.1
    rig = StereoRig(camera, camera, T)
    assert vertical_disparity(rig, [(left, right)]).acceptable
    moved = cv2.warpAffine(right, np.array([[1, 0, 0], [0, 1, 1.5]]), (width, height))
    assert vertical_disparity(rig, [(left, moved)]).offset_px == pytest.approx(1.5, abs=0.15)
    assert len(find_matches(Rectification.from_rig(rig), left, right).left) > 200


@pytest.mark.parametrize(("row_px", "moved"), [(0.6, True), (58.0, False)])
def test_only_what_a_camera_can_move_by_is_refined(row_px: float, moved: bool) -> None:
    """Neighboring frames taken for a pair have rows that an offset explains too, of tens of
    pixels.
    """
    check = RowCheck(3, 500, row_px, row_px, 1.0, 0.0, 0.1 * row_px, 0.0)
    assert check.has_moved == moved
    assert ("a camera has moved" in check.advice[0]) == moved
    assert ("not exposed at the same moment" in check.advice[0]) != moved
