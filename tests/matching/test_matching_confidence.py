"""What the confidence of a disparity is judged from: its surroundings, and the gray on both sides
of an edge of depth.
"""

import numpy as np
import pytest
from matching_scenes import render

from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.matching.context import ROUGHEST_PX, Context, enlarged
from stereo_seecolor.matching.disparity import MatchedDisparity
from stereo_seecolor.matching.fattening import fattening
from stereo_seecolor.matching.matcher import Matcher

SHAPE = 61, 82  # sides that are no multiples of the samples' distance
EVERYTHING = slice(0, SHAPE[0])


def matched(best: np.ndarray, checked: np.ndarray | None = None) -> MatchedDisparity:
    disparity = best if checked is None else np.where(checked, best, np.nan)
    return MatchedDisparity(
        disparity.astype(np.float32), best.astype(np.float32), np.ones(best.shape, np.float32)
    )


def fattened(
    best: np.ndarray, left: np.ndarray, rows: slice = EVERYTHING, odds: float = 1.0
) -> np.ndarray:
    context = Context.of(matched(best), left)
    return fattening(
        (best.astype(np.float32), left),
        context,
        rows,
        np.full((rows.stop - rows.start, SHAPE[1]), odds, np.float32),
        0.5,
    )


def gray(levels: np.ndarray | float) -> np.ndarray:
    return np.broadcast_to(np.asarray(levels) * 256, SHAPE).astype(np.uint16)


def test_a_plane_that_is_known_is_not_rough() -> None:
    context = Context.of(matched(np.full(SHAPE, 20.0)), gray(100))
    np.testing.assert_allclose(context.known, 1)
    np.testing.assert_allclose(context.roughness, 0, atol=1e-5)


def test_pixels_that_failed_a_check_count_as_unknown_but_not_as_rough() -> None:
    checked = np.zeros(SHAPE, np.bool_)
    checked[:, :41] = True
    context = Context.of(matched(np.full(SHAPE, 20.0), checked), gray(100))
    assert context.known[:, 0] == pytest.approx(1) and context.known[:, -1] == pytest.approx(0)
    np.testing.assert_allclose(context.roughness, 0, atol=1e-5)


def test_a_branching_surface_is_rough_and_its_edges_count_alike() -> None:
    branches = np.where(np.arange(SHAPE[1]) // 8 % 2 == 1, 40.0, 20.0) + np.zeros(SHAPE)
    rough = Context.of(matched(branches), gray(100)).roughness
    rougher = Context.of(matched(branches * 3), gray(100)).roughness
    assert rough.min() > 1
    assert rougher.max() <= ROUGHEST_PX and np.allclose(rough, rougher)


def test_where_nothing_was_found_the_surroundings_stay_finite() -> None:
    nothing = np.full(SHAPE, np.nan)
    context = Context.of(matched(nothing), gray(100))
    assert np.isfinite(context.roughness).all() and not context.known.any()
    assert not fattened(nothing, gray(100)).any()


def test_samples_are_interpolated_to_the_size_of_the_image() -> None:
    for shape in ((61, 82), (64, 81), (63, 83), (8, 9)):
        samples = np.add.outer(*(np.arange(2, side, 4, dtype=np.float32) for side in shape))
        y, x = np.mgrid[: shape[0], : shape[1]]
        whole = enlarged(samples, shape)
        assert whole.shape == shape
        inside = np.s_[4:-6, 4:-6]
        # samples stand half a pixel off the middle
        np.testing.assert_allclose(whole[inside], (x + y)[inside] + 1, atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [EVERYTHING, slice(16, 37)])
def test_a_pixel_with_the_gray_of_what_lies_behind_is_fattened(rows: slice) -> None:
    """A near surface from column 40 on, whose disparity spreads 4 pixels over the far, darker
    one.
    """
    column = np.arange(SHAPE[1])
    best = np.where(column >= 36, 40.0, 20.0) + np.zeros(SHAPE)
    left = gray(np.where(column >= 40, 160, 60))
    found = fattened(best, left, rows)
    assert found.shape == (rows.stop - rows.start, SHAPE[1])
    assert found[:, 36:40].min() > 0.9
    assert found[:, 40:46].max() < 0.25  # the mean of the near surface takes in what spreads
    assert not found[:, :36].any() and not found[:, 60:].any()


def test_equal_grays_say_nothing_about_the_edge() -> None:
    best = np.where(np.arange(SHAPE[1]) >= 36, 40.0, 20.0) + np.zeros(SHAPE)
    found = fattened(best, gray(100))
    np.testing.assert_allclose(found[:, 36:40], 0.5)
    assert not fattened(best, gray(100), odds=0.4).any()  # rejected already


@pytest.mark.slow
def test_less_confidence_leaves_the_ranges_that_are_known_as_they_are() -> None:
    scene = render((320, 256), relief_m=0.5, seed=3)
    strict, loose = (
        Matcher(scene.pair, MatchingConfig(min_range_m=0.8, min_confidence=least)).match(
            scene.frame
        )
        for least in (0.8, 0.2)
    )
    known = np.isfinite(strict.range_m)
    assert np.isfinite(loose.range_m).sum() > 1.005 * known.sum()
    np.testing.assert_array_equal(loose.range_m[known], strict.range_m[known])
    assert loose.confidence[np.isfinite(loose.range_m) & ~known].max() < 0.8
