"""The compiled search against the reference in sgm_reference.py, to the bit."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import sgm_reference
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from stereo_seecolor.matching.sgm import search as sgm
from stereo_seecolor.matching.sgm.band import LANES, TILE, WIDENING, Band
from stereo_seecolor.matching.sgm.penalties import PENALTIES


def pair(
    seed: int, height: int, width: int, shift: int, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Random texture, in the right image a number of pixels to the left, with steps of gray and
    noise.
    """
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(
        rng.uniform(0, 65535, (height, width + abs(shift))).astype(np.float32), (0, 0), 1.0
    )
    texture[height // 2 :] *= 0.5
    left, right = (
        texture[:, first : first + width] for first in ((0, shift) if shift >= 0 else (-shift, 0))
    )
    return tuple(
        np.clip(image + rng.normal(0, noise, image.shape), 0, 65535).astype(np.uint16)
        for image in (left, right)
    )


def reference(left: np.ndarray, right: np.ndarray, band: Band) -> np.ndarray:
    constants = sgm.CONSTANTS
    settings = sgm_reference.Settings(
        PENALTIES.p2, PENALTIES.p2_least, PENALTIES.texture_levels, PENALTIES.edge_levels,
        constants.ambiguous, constants.strip,
        constants.halo, constants.band_edge_pixels, constants.band_edge_tiles, WIDENING,
    )  # fmt: skip
    return sgm_reference.search(left, right, band.lowest, band.count, settings)


def assert_equal_to_reference(left: np.ndarray, right: np.ndarray, band: Band) -> np.ndarray:
    found = sgm.search(left, right, band)
    disparity, best, uniqueness = reference(left, right, band)
    np.testing.assert_array_equal(found.disparity, disparity)
    np.testing.assert_array_equal(found.best, best)
    np.testing.assert_array_equal(found.uniqueness, uniqueness)
    return disparity


@pytest.fixture(autouse=True, scope="module")
def low_strips():
    """Small images then have several strips."""
    usual = sgm.CONSTANTS
    sgm.CONSTANTS = replace(usual, strip=16, halo=8)
    yield
    sgm.CONSTANTS = usual


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.integers(4, 42), st.integers(4, 42)),
    shift=st.integers(-6, 20),
    noise=st.sampled_from([0.0, 300.0, 5000.0]),
)
@hypothesis_settings(max_examples=12)
def test_random_images_in_random_bands(
    seed: int, size: tuple[int, int], shift: int, noise: float
) -> None:
    rng = np.random.default_rng(seed)
    tiles = tuple(-(-side // TILE) for side in size)
    lowest = (shift + rng.integers(-20, 3, tiles)).astype(np.int32)
    band = Band(lowest, (LANES * rng.integers(1, 4, tiles)).astype(np.int32))
    assert_equal_to_reference(*pair(seed, *size, shift, noise), band)


@pytest.mark.slow
def test_one_band_for_all_tiles() -> None:
    disparity = assert_equal_to_reference(
        *pair(1, 40, 64, 9, 200.0), Band.everywhere((40, 64), 0, 15)
    )
    assert np.nanmedian(disparity) == pytest.approx(9, abs=0.2)
    assert np.isfinite(disparity[:, 12:]).mean() > 0.9


@pytest.mark.slow
def test_a_band_that_misses_is_widened() -> None:
    disparity = assert_equal_to_reference(
        *pair(2, 32, 64, 20, 0.0), Band.everywhere((32, 64), 5, 20)
    )
    assert np.nanmedian(disparity) == pytest.approx(20, abs=0.2)


@pytest.mark.slow
def test_nothing_is_unique_in_an_even_image() -> None:
    even = np.full((24, 40), 1000, np.uint16)
    assert np.isnan(assert_equal_to_reference(even, even, Band.everywhere(even.shape, 0, 31))).all()
