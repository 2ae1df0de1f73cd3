from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration import Camera, Rectification, StereoRig
from stereo_seecolor.errors import MatchingError
from stereo_seecolor.matching.image_texture import textured_fraction
from stereo_seecolor.matching.pair_check import PAIR_CHECK_CONSTANTS, PairCheck, coverage
from stereo_seecolor.records import RangeMap, StereoFrame

PIXELS = 1000


def matched(fraction: float, *warnings: str) -> RangeMap:
    """A range map of which that fraction is known."""
    range_m = np.full((10, PIXELS // 10), np.nan, np.float32)
    range_m.flat[: round(fraction * PIXELS)] = 1.0
    return RangeMap(*[range_m] * 5, np.zeros(range_m.shape, np.bool_), warnings)


def pair(name: str) -> StereoFrame:
    return StereoFrame(name, np.zeros((10, 100, 3), np.uint8), np.ones((10, 100, 3), np.uint8))


class Swapped:
    """Matches pairs the other way round, and counts them."""

    def __init__(self, fraction: float) -> None:
        self.fraction, self.names = fraction, []

    def __call__(self, raw: StereoFrame) -> RangeMap:
        assert raw.left.all() and not raw.right.any()
        self.names.append(raw.name)
        return matched(self.fraction)


def test_coverage_counts_known_ranges() -> None:
    assert coverage(matched(0.25)) == 0.25


def test_a_pair_that_matches_well_passes_without_more_matching() -> None:
    swapped = Swapped(0.9)
    PairCheck(swapped)("a", matched(0.4), partial(pair, "a"))
    assert swapped.names == []


def test_a_pair_of_which_little_matches_passes() -> None:
    little = matched(0.2)
    assert PairCheck(Swapped(0.05))("a", little, partial(pair, "a")) is little


def test_images_of_different_scenes_fail() -> None:
    with pytest.raises(
        MatchingError,
        match=r"^a: only 2\.0% of the pixels match: the two images do not show the same scene",
    ):
        PairCheck(Swapped(0.02))("a", matched(0.02), partial(pair, "a"))


def water(seed: int) -> np.ndarray:
    """Brighter above, with a camera's noise and a few drifting particles."""
    rng = np.random.default_rng(seed)
    image = np.linspace(120, 80, 480)[:, None, None] * np.ones((1, 640, 3)) + rng.normal(
        0, 2, (480, 640, 3)
    )
    image[rng.integers(0, 480, 40), rng.integers(0, 640, 40)] += 100
    return np.clip(image, 0, 255).astype(np.uint8)


def reef(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = [
        cv2.resize(
            rng.normal(100, 20, (480 // n, 640 // n)), (640, 480), interpolation=cv2.INTER_CUBIC
        )
        for n in (2, 4, 8)
    ]
    return np.clip(
        np.mean(coarse, axis=0)[..., None] + rng.normal(0, 2, (480, 640, 3)), 0, 255
    ).astype(np.uint8)


@pytest.mark.parametrize(
    ("left", "right", "said"),
    [(reef(0), water(1), "the right image shows"), (water(0), reef(1), "the left image shows")],
)
def test_images_without_texture_are_not_called_two_scenes(
    left: np.ndarray, right: np.ndarray, said: str
) -> None:
    """Nor are they matched the other way round, which later pairs may need."""
    swapped = Swapped(0.9)
    with pytest.raises(
        MatchingError,
        match=rf"^a: only 1\.0% of the pixels match: {said} too little texture to match",
    ):
        PairCheck(swapped)("a", matched(0.01), lambda: StereoFrame("a", left, right))
    assert swapped.names == []


def test_pairs_without_texture_are_known_nowhere() -> None:
    known = PairCheck(Swapped(0.9))(
        "a", matched(0.01), lambda: StereoFrame("a", water(0), water(1))
    )
    assert np.isnan(known.range_m).all() and not known.confidence.any() and not known.filled.any()
    assert known.warnings[0].startswith(
        "only 1.0% of the pixels match: both images show too little texture to match"
    )


def test_images_with_texture_that_do_not_match_are_two_scenes() -> None:
    with pytest.raises(MatchingError, match="the two images do not show the same scene"):
        PairCheck(lambda raw: matched(0.01))(
            "a", matched(0.01), lambda: StereoFrame("a", reef(0), reef(1))
        )


def test_frames_half_in_the_dark_can_still_be_two_scenes() -> None:
    left, right = reef(0), reef(1)
    for image in (left, right):
        image[: image.shape[0] // 2] = water(2)[: image.shape[0] // 2] // 20
    with pytest.raises(MatchingError):
        PairCheck(lambda raw: matched(0.01))(
            "a", matched(0.01), lambda: StereoFrame("a", left, right)
        )


def test_water_of_which_something_matches_passes() -> None:
    little = matched(0.2)
    assert (
        PairCheck(lambda raw: matched(0.05))(
            "a", little, lambda: StereoFrame("a", water(0), water(1))
        )
        is little
    )


def test_an_image_that_cannot_be_matched_fails_with_the_reason() -> None:
    swapped = Swapped(0.9)
    with pytest.raises(MatchingError, match=r"^a: the left image is black$"):
        PairCheck(swapped)("a", matched(0, "the left image is black"), partial(pair, "a"))
    assert swapped.names == []


def test_swapped_sides_are_named_for_every_pair_after_one_trial() -> None:
    swapped = Swapped(0.8)
    check = PairCheck(swapped)
    for name in "abcd":
        with pytest.raises(
            MatchingError,
            match=f"^{name}: left and right look swapped: 10% .*: exchange --left and --right .* "
            "change input.right_half_first",
        ):
            check(name, matched(0.1), partial(pair, name))
    assert swapped.names == ["a"]


def test_a_dive_of_poor_pairs_is_not_matched_twice() -> None:
    swapped = Swapped(0.1)
    check = PairCheck(swapped)
    for number in range(20):
        check(str(number), matched(0.2), partial(pair, str(number)))
    assert len(swapped.names) == PAIR_CHECK_CONSTANTS.swap_tries


@pytest.mark.real_data
def test_real_water_is_told_from_real_bottoms(real_data: Path) -> None:
    frames = {
        path.stem: cv2.imread(str(path))
        for path in sorted((real_data / "flsea" / "rgb").glob("*.tiff"))
    }
    assert frames and all(textured_fraction(image) > 0.6 for image in frames.values())
    for water in (
        frames["0003"][:150, 500:],
        frames["0006"][:190, :170],
        frames["0010"][:180, 560:700],
    ):
        assert textured_fraction(water.copy()) < 0.1


@pytest.mark.slow
def test_rows_that_are_off_are_named_before_another_scene() -> None:
    left = reef(0)
    right = np.roll(left, (5, -9), axis=(0, 1))
    check = PairCheck(lambda raw: matched(0.01), Rectification.from_rig(plain_rig(left)))
    with pytest.raises(MatchingError, match=r"^a: only 1\.0% .* by 5\.\d px \(median.*--refine"):
        check("a", matched(0.01), lambda: StereoFrame("a", left, right))
    refined = PairCheck(lambda raw: matched(0.01), check._rectification, refines=True)
    with pytest.raises(MatchingError, match="since the calibration, or"):
        refined("a", matched(0.01), lambda: StereoFrame("a", left, right))
    with pytest.raises(MatchingError):
        check("a", matched(0.01), lambda: StereoFrame("a", left, reef(1)))


def plain_rig(image: np.ndarray) -> StereoRig:
    """Two parallel cameras without distortion."""
    height, width = image.shape[:2]
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], np.float64)
    T = np.eye(4)
    T[0, 3] = -0.1
    return StereoRig(*[Camera(K, np.zeros(5), (width, height))] * 2, T)
