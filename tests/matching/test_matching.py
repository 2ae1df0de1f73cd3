"""Range maps against known truth, and what comes out of pairs that cannot be matched."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from matching_scenes import Scene, render
from pydantic import ValidationError

from calibration import RectifiedPair
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.matching import reduced
from stereo_seecolor.matching.diagnostics import right_sharpness
from stereo_seecolor.matching.gray import GrayPair
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.reduced import DetailMatcher
from stereo_seecolor.matching.refine import error_factor
from stereo_seecolor.records import RangeMap, StereoFrame

CONFIG = MatchingConfig(min_range_m=0.8)


@lru_cache
def scene(**options: float) -> Scene:
    return render(**{"image_size": (480, 384), "relief_m": 0.5, "seed": 3} | options)


def match(scene: Scene, config: MatchingConfig = CONFIG) -> RangeMap:
    return Matcher(scene.pair, config).match(scene.frame)


def swapped(scene: Scene, left: np.ndarray, right: np.ndarray) -> Scene:
    return replace(scene, frame=StereoFrame("pair", left, right))


def bad_fraction(found: RangeMap, scene: Scene, px: float) -> float:
    error = np.abs(found.disparity - scene.disparity)[np.isfinite(found.disparity)]
    return float((error > px).mean())


@pytest.mark.slow
def test_clear_water_is_dense_and_right() -> None:
    found = match(scene())
    assert np.isfinite(found.range_m)[scene().both].mean() > 0.93
    assert bad_fraction(found, scene(), 1.0) < 0.015
    known = np.isfinite(found.range_m)
    truth_m = scene().pair.range_from_depth(scene().depth_m)
    assert np.median(np.abs(found.range_m / truth_m - 1)[known]) < 0.003
    assert found.warnings == ()


@pytest.mark.slow
def test_a_black_rim_around_the_picture_has_no_range() -> None:
    """As of a round picture, or the corners of an undistorted one; its edge looks like something 6
    m away.
    """
    whole = scene()
    y, x = np.mgrid[:384, :480]
    black, right_black = (np.hypot(x - middle, y - 192) > 220 for middle in (240, 231))
    images = [
        np.where(rim[..., None], 0, image)
        for rim, image in ((black, whole.frame.left), (right_black, whole.frame.right))
    ]
    found, plain = match(swapped(whole, *images)), match(whole)
    known = np.isfinite(found.range_m)
    assert known[black].mean() < 0.002
    assert (np.abs(found.disparity - whole.disparity)[known] > 2).mean() < 0.01
    inside = np.hypot(x - 240, y - 192) < 180
    assert known[inside].mean() > np.isfinite(plain.range_m)[inside].mean() - 0.03


@pytest.mark.slow
def test_large_images_without_detail_at_their_full_size_are_matched_at_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A sharp pair enlarged four times, with the noise of a camera: neighboring pixels say nothing
    there.
    """
    small, rng = scene(), np.random.default_rng(0)

    def enlarged(image: np.ndarray) -> np.ndarray:
        large = cv2.resize(image, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
        return np.clip(large + rng.normal(0, 5, large.shape), 0, 255).astype(np.uint8)

    pair = small.pair
    focal_px, (cx_left_px, cx_right_px, cy_px) = (
        4 * pair.focal_px,
        (4 * c + 1.5 for c in (pair.cx_left_px, pair.cx_right_px, pair.cy_px)),
    )
    size = (4 * pair.image_size[0], 4 * pair.image_size[1])
    large = RectifiedPair(focal_px, cx_left_px, cx_right_px, cy_px, pair.baseline_m, size)
    frame = StereoFrame("pair", enlarged(small.frame.left), enlarged(small.frame.right))
    plain = Matcher(large, CONFIG).match(frame)
    assert np.array_equal(
        DetailMatcher(large, CONFIG).match(frame).range_m, plain.range_m, equal_nan=True
    ), "too small for it"
    monkeypatch.setattr(reduced, "LEAST_PIXELS", small.depth_m.size)
    found = DetailMatcher(large, CONFIG).match(frame)
    assert np.isfinite(plain.range_m).mean() + 0.1 < np.isfinite(found.range_m).mean()
    assert "matched at 1/2 of it" in found.warnings[-1]
    depth_m = cv2.resize(small.depth_m, size, interpolation=cv2.INTER_NEAREST)
    assert np.nanmedian(np.abs(found.depth_m / depth_m - 1)) < 0.005
    assert DetailMatcher(pair, CONFIG).match(small.frame).warnings == ()


def test_a_matcher_of_a_smaller_size_is_made_once() -> None:
    """With a network, each would load it again."""
    made: list[RectifiedPair] = []

    def make(pair: RectifiedPair, *_: object) -> Matcher:
        made.append(pair)
        return Matcher(pair, CONFIG)

    matcher = DetailMatcher(scene().pair, CONFIG, make=make)
    assert matcher.at(2) is matcher.at(2)
    assert len(made) == 2  # at the full size and at half of it


@pytest.mark.slow
def test_maps_agree_with_one_another() -> None:
    found, pair = match(scene()), scene().pair
    known = np.isfinite(found.disparity)
    assert np.array_equal(known, np.isfinite(found.range_m)) and np.array_equal(
        known, np.isfinite(found.range_std_m)
    )
    assert np.array_equal(known, found.confidence > 0)
    np.testing.assert_allclose(
        found.depth_m[known], pair.depth_from_disparity(found.disparity)[known]
    )
    assert np.all(found.range_m[known] >= found.depth_m[known])
    assert not found.filled.any()


@pytest.mark.slow
def test_principal_points_may_differ() -> None:
    moved = scene(doffs_px=11.0)
    found = match(moved)
    assert np.nanmedian(np.abs(found.depth_m / moved.depth_m - 1)) < 0.003


@pytest.mark.slow
@pytest.mark.parametrize("altitude_m", [1.0, 2.0, 4.0])
def test_flat_bottom_has_no_bias(altitude_m: float) -> None:
    flat = scene(altitude_m=altitude_m, relief_m=0.0)
    found = match(flat, MatchingConfig(min_range_m=0.7))
    assert abs(np.nanmedian(found.depth_m / flat.depth_m) - 1) < 0.003


@pytest.mark.slow
def test_fractions_of_disparity_are_not_locked_to_whole_pixels() -> None:
    slope = scene(relief_m=0.05, tilt=0.5)
    found = match(slope)
    known = np.isfinite(found.disparity)
    histogram = [
        np.histogram(d[known] % 1, 10, (0, 1))[0] for d in (found.disparity, slope.disparity)
    ]
    assert np.all(np.abs(histogram[0] / histogram[1] - 1) < 0.2)


@pytest.mark.slow
def test_standard_error_is_that_of_the_range() -> None:
    hazy = scene(haze_per_m=0.4, noise=2.0)
    found = match(hazy)
    truth_m = hazy.pair.range_from_depth(hazy.depth_m)
    z = ((found.range_m - truth_m) / found.range_std_m)[hazy.both & np.isfinite(found.range_m)]
    assert 0.5 < 1.4826 * np.median(np.abs(z)) < 1.5


@pytest.mark.slow
def test_standard_errors_include_what_denoising_hides() -> None:
    hazy = scene(haze_per_m=0.4, noise=2.0)
    images = (hazy.frame.left, hazy.frame.right)
    smooth = swapped(hazy, *(cv2.fastNlMeansDenoisingColored(i, None, 5, 5, 5, 15) for i in images))
    found, gray = match(smooth), GrayPair.from_frame(smooth.frame, 2)
    factor = error_factor(gray.left, gray.right, found.disparity)
    z = (found.range_m - hazy.pair.range_from_depth(hazy.depth_m)) / found.range_std_m
    spread = 1.4826 * np.nanmedian(np.abs(z[hazy.both]))
    assert spread < 1.2 < 1.3 < factor * spread


@pytest.mark.slow
def test_standard_errors_of_independent_noise_stay() -> None:
    hazy = scene(haze_per_m=0.4, noise=2.0)
    gray = GrayPair.from_frame(hazy.frame, 2)
    found = match(hazy).disparity
    assert error_factor(gray.left, gray.right, found) == 1.0
    assert error_factor(gray.left, gray.right, np.full_like(found, np.nan)) == 1.0


@pytest.mark.slow
def test_confidence_means_what_it_says() -> None:
    hazy = scene(haze_per_m=0.7, noise=2.5, seed=8)
    found = match(hazy, MatchingConfig(min_range_m=0.8, min_confidence=0.0))
    right = np.abs(found.disparity - hazy.disparity) <= 1
    sure = (found.confidence > 0.85) & (found.confidence < 0.95)
    assert sure.sum() > 2000
    assert 0.82 < right[sure].mean() < 0.99
    unsure = (found.confidence > 0) & (found.confidence < 0.5)
    assert right[unsure].mean() < 0.7


@pytest.mark.slow
def test_exposure_may_differ() -> None:
    darker = swapped(scene(), scene().frame.left, (scene().frame.right * 0.6 + 8).astype(np.uint8))
    found = match(darker)
    assert np.isfinite(found.range_m)[scene().both].mean() > 0.9
    assert bad_fraction(found, scene(), 1.0) < 0.02


@pytest.mark.slow
def test_sixteen_bits_hold_the_same_scene() -> None:
    wide = swapped(
        scene(),
        *(image.astype(np.uint16) * 257 for image in (scene().frame.left, scene().frame.right)),
    )
    difference = np.abs(match(wide).disparity - match(scene()).disparity)
    assert np.isfinite(difference).mean() > 0.85
    assert np.nanpercentile(difference, 99) < 0.05


@pytest.mark.slow
def test_order_and_threads_do_not_matter() -> None:
    scenes = [scene(), scene(haze_per_m=0.4, noise=2.0)]
    matcher = Matcher(scene().pair, CONFIG)
    alone = [Matcher(s.pair, CONFIG).match(s.frame) for s in scenes]
    with ThreadPoolExecutor(4) as pool:
        together = list(
            pool.map(lambda s: matcher.match(s.frame), [scenes[1], scenes[0], scenes[1], scenes[0]])
        )
    for found, expected in zip(together, [alone[1], alone[0], alone[1], alone[0]], strict=True):
        np.testing.assert_array_equal(found.range_m, expected.range_m)
        np.testing.assert_array_equal(found.confidence, expected.confidence)


@pytest.mark.slow
def test_what_the_left_camera_did_not_see_is_unknown() -> None:
    seen = np.ones(scene().disparity.shape, np.bool_)
    seen[:, 200:230] = False
    for fill in (False, True):
        found = Matcher(scene().pair, MatchingConfig(min_range_m=0.8, fill=fill), seen).match(
            scene().frame
        )
        assert (
            np.isnan(found.range_m[~seen]).all() and np.isfinite(found.range_m[seen]).mean() > 0.8
        )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_what_lies_just_outside_the_right_image_is_not_matched_with_its_border(seed: int) -> None:
    """Up to 0.01 % of the pixels were."""
    flat = render((480, 360), altitude_m=1.0, relief_m=0.0, noise=1.5, seed=seed)
    found = match(flat, MatchingConfig(min_range_m=0.5))
    column = np.arange(480, dtype=np.float32)
    assert np.nanmin(column - found.disparity) >= 0.49  # an ulp of the disparity
    outside = column - flat.disparity < 0
    assert np.isfinite(found.disparity)[outside].mean() < 0.001
    assert np.isfinite(found.disparity)[~outside].mean() > 0.99


@pytest.mark.slow
def test_ranges_outside_the_limits_are_unknown() -> None:
    found = match(scene(), MatchingConfig(min_range_m=1.75, max_range_m=2.0))
    assert np.nanmin(found.range_m) >= 1.75 and np.nanmax(found.range_m) <= 2.0
    assert np.nanmin(found.depth_m) < 1.75  # off the axis, a point is nearer in depth than in range


@pytest.mark.slow
def test_the_nearest_range_is_found_in_the_corners_too() -> None:
    flat = render(altitude_m=1.0, relief_m=0.0)
    corner = np.s_[-40:-8, -40:-8]
    range_m = (flat.depth_m * flat.pair.ray_length)[corner]
    found = match(flat, MatchingConfig(min_range_m=float(range_m.min()) - 0.01))
    assert np.isfinite(found.range_m[corner]).mean() > 0.8


def test_filling_is_marked_and_leaves_the_measured_alone() -> None:
    measured, filled = match(scene()), match(scene(), MatchingConfig(min_range_m=0.8, fill=True))
    known = np.isfinite(measured.range_m)
    np.testing.assert_array_equal(filled.range_m[known], measured.range_m[known])
    np.testing.assert_array_equal(filled.filled, np.isfinite(filled.range_m) & ~known)
    assert np.isfinite(filled.range_m).mean() > 0.98
    assert (
        np.all(filled.confidence[filled.filled] == 0)
        and np.isnan(filled.range_std_m[filled.filled]).all()
    )
    np.testing.assert_array_equal(filled.measured_m, measured.range_m)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (0, "the left image is black"),
        (255, "the left image is saturated"),
        (90, "the left image is uniform"),
    ],
)
def test_empty_images_are_named(value: int, complaint: str) -> None:
    empty = swapped(scene(), np.full_like(scene().frame.left, value), scene().frame.right)
    found = match(empty)
    assert found.warnings == (f"{complaint}: no range is known",) or complaint in found.warnings[0]
    assert np.isnan(found.range_m).all() and not found.confidence.any()


def test_one_image_twice_is_named() -> None:
    found = match(swapped(scene(), scene().frame.left, scene().frame.left))
    assert "same image" in found.warnings[0] and np.isnan(found.range_m).all()


@pytest.mark.parametrize("period_px", [12, 24, 40])
def test_repeated_stripes_are_not_noise(period_px: int) -> None:
    wave = (128 + 80 * np.sin(2 * np.pi * np.arange(480 + 30) / period_px)).astype(np.uint8)
    left, right = (
        np.repeat(np.tile(w, (384, 1))[..., None], 3, axis=2) for w in (wave[:480], wave[30:])
    )
    found = match(swapped(scene(), left, right))
    assert any("repeats" in warning for warning in found.warnings)
    assert np.isfinite(found.range_m).mean() < 0.05


def test_a_fish_that_one_camera_sees_is_a_hole() -> None:
    left = scene().frame.left.copy()
    fish = np.zeros(left.shape[:2], np.uint8)
    cv2.ellipse(fish, (260, 200), (50, 22), 10, 0, 360, 1, -1)
    scales = np.random.default_rng(1).integers(60, 220, left.shape).astype(np.uint8)
    left[fish == 1] = cv2.GaussianBlur(scales, (0, 0), 1.5)[fish == 1]
    found = match(swapped(scene(), left, scene().frame.right))
    inside = cv2.erode(fish, np.ones((9, 9), np.uint8)) == 1
    assert np.isfinite(found.range_m[inside]).mean() < 0.1
    assert any("has no match" in warning for warning in found.warnings)


def test_rows_that_do_not_correspond_are_reported() -> None:
    right = np.roll(scene().frame.right, 2, axis=0)
    found = match(swapped(scene(), scene().frame.left, right))
    (complaint,) = [warning for warning in found.warnings if "vertical disparity" in warning]
    assert 1.5 < float(complaint.split()[3]) < 2.5


@pytest.mark.slow
@pytest.mark.parametrize("shift_px", [-0.6, -0.3, 0.0, 0.1, 0.5])
def test_the_vertical_disparity_of_a_frame_is_measured_below_a_pixel(shift_px: float) -> None:
    right = scene().frame.right
    size = right.shape[1], right.shape[0]
    moved = cv2.warpAffine(
        right,
        np.array([[1.0, 0, 0], [0, 1, shift_px]]),
        size,
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT,
    )
    found = match(swapped(scene(), scene().frame.left, moved))
    assert found.vertical_px == pytest.approx(shift_px, abs=0.08)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("side", "blur_px", "wanted"),
    [("right", 0.0, 1.0), ("right", 1.0, 0.8), ("right", 2.0, 0.53), ("left", 2.0, 1 / 0.53)],
)
def test_the_side_that_is_less_sharp_is_measured(side: str, blur_px: float, wanted: float) -> None:
    """Noise of the camera comes after the lens."""
    exact = scene(noise=0.0)
    images = {"left": exact.frame.left, "right": exact.frame.right}
    if blur_px:
        images[side] = cv2.GaussianBlur(images[side], (0, 0), blur_px)
    noise = np.random.default_rng(0).normal(0, 1.5, (2, *images["left"].shape))
    noisy = [
        np.clip(np.rint(image + more), 0, 255).astype(np.uint8)
        for image, more in zip(images.values(), noise, strict=True)
    ]
    found = match(swapped(exact, *noisy))
    assert found.right_sharpness == pytest.approx(wanted, rel=0.15)


def test_sides_of_a_small_image_are_not_compared() -> None:
    gray = np.zeros((40, 60), np.uint16)
    assert np.isnan(right_sharpness(gray, gray, np.zeros(gray.shape, np.float32)))


@pytest.mark.slow
def test_veil_and_a_tone_curve_on_one_side_are_no_blur() -> None:
    exact = scene()
    right = exact.frame.right / 255
    for other in (0.25 + 0.7 * right, right**2.2, 0.5 * right):
        found = match(swapped(exact, exact.frame.left, np.uint8(np.rint(255 * other))))
        assert found.right_sharpness == pytest.approx(1, abs=0.12)


@pytest.mark.slow
def test_unrelated_images_give_next_to_nothing() -> None:
    found = match(swapped(scene(), scene().frame.left, scene(seed=4).frame.right[::-1]))
    assert np.isfinite(found.range_m).mean() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("doffs_px", [0.0, 20.0])
def test_opencv_finds_the_same_bottom(doffs_px: float) -> None:
    view = render((320, 256), relief_m=0.2, seed=3, focal_px=450.0, doffs_px=doffs_px)
    found, ours = (
        Matcher(view.pair, MatchingConfig(engine=engine, min_range_m=0.8)).match(view.frame)
        for engine in ("opencv", "sgm")
    )
    known = np.isfinite(found.disparity)
    assert known[view.both].mean() > 0.8
    assert (np.abs(found.disparity - view.disparity)[known] <= 1).mean() > 0.98
    assert np.nanmedian(np.abs(found.range_m - ours.range_m)) < 0.003
    assert found.confidence[known].min() >= 0.75 and not found.confidence[~known].any()


def test_the_former_name_of_the_engine_is_refused_with_the_new_one() -> None:
    with pytest.raises(
        ValidationError, match="is now called 'sgm'; 'opencv' is OpenCV's StereoSGBM"
    ):
        MatchingConfig(engine="sgbm")


@pytest.mark.real_data
def test_teddy(real_data: Path) -> None:
    left, right = (
        cv2.imread(str(real_data / "teddy" / f"{side}.png"))[..., ::-1].copy()
        for side in ("left", "right")
    )
    truth = cv2.imread(
        str(real_data / "teddy" / "disparity_x4.pgm"), cv2.IMREAD_GRAYSCALE
    ) / np.float32(4)
    height, width = truth.shape
    pair = RectifiedPair(500.0, width / 2, width / 2, height / 2, 0.1, (width, height))
    for fill, coverage, bad in ((False, 0.82, 0.02), (True, 0.98, 0.06)):
        found = Matcher(pair, MatchingConfig(min_range_m=50 / 64, fill=fill)).match(
            StereoFrame("teddy", left, right)
        )
        known = (truth > 0) & np.isfinite(found.disparity)
        assert known.sum() / (truth > 0).sum() > coverage
        assert (np.abs(found.disparity - truth) > 2)[known].mean() < bad
