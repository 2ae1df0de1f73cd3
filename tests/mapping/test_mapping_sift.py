"""Which descriptors look alike: mutual nearest ones that pass Lowe's ratio test, however many are
compared at a time.
"""

import numpy as np
import pytest

from stereo_seecolor.mapping.track import sift
from stereo_seecolor.mapping.track.near_matches import match_near


def test_each_is_the_others_nearest_and_clearly_so() -> None:
    a = np.zeros((4, 128), np.float32)
    a[:, 0] = [0, 10, 20, 21]
    b = np.zeros((4, 128), np.float32)
    b[:, 0] = [21, 1, 10, 11.5]
    index_a, index_b = sift.match_descriptors(a, b, 0.8)
    # 20 and 21 both are nearest to 21, whose nearest is 21
    assert list(zip(index_a.tolist(), index_b.tolist(), strict=True)) == [(0, 1), (1, 2), (3, 0)]
    assert sift.match_descriptors(a, b[[2, 3]] - [[0] * 128, [1] * 128], 0.01)[0].tolist() == [1]
    assert not len(sift.match_descriptors(a[:1], b, 0.8)[0])


def test_parts_give_what_the_whole_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    a = rng.integers(0, 255, (300, 128)).astype(np.float32)
    b = np.concatenate(
        [
            a[rng.permutation(300)[:200]] + rng.normal(0, 40, (200, 128)),
            rng.integers(0, 255, (90, 128)),
        ]
    ).astype(np.float32)
    whole = sift.match_descriptors(a, b, 0.9)
    monkeypatch.setattr(sift, "AT_ONCE", 7)
    parts = sift.match_descriptors(a, b, 0.9)
    assert 150 < len(whole[0]) < 250
    assert [index.tolist() for index in parts] == [index.tolist() for index in whole]


def test_near_its_expected_place_a_feature_is_found_among_others_that_look_like_it_elsewhere() -> (
    None
):
    rng = np.random.default_rng(2)
    # all look alike but for a little
    a = np.repeat(rng.integers(0, 255, (1, 128)), 40, axis=0).astype(np.uint8)
    a[:, :30] = rng.integers(0, 120, (40, 30))
    places = rng.uniform(0, 1, (40, 2))
    order = rng.permutation(40)
    expected = places + rng.uniform(-0.02, 0.02, (40, 2))
    expected[:5] = np.nan  # not in the other image
    index_a, index_b = match_near(a, expected, a[order], places[order], 0.2, 0.8)
    assert len(index_a) > 20 and index_a.min() == 5
    assert np.array_equal(order[index_b], index_a)
    assert not len(match_near(a, expected + 0.5, a[order], places[order], 0.02, 0.8)[0])


def test_a_flat_image_has_no_keypoints() -> None:
    pixels, descriptors = sift.keypoints(
        np.full((64, 64), 128, np.uint8), np.ones((64, 64), np.uint8), 100
    )
    assert pixels.shape == (0, 2) and descriptors.shape == (0, 128)
