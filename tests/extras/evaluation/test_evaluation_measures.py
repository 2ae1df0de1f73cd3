import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo_seecolor.errors import DeviceError
from stereo_seecolor.extras.evaluation import measures
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb

# Sharma, Wu and Dalal 2005, "The CIEDE2000 color-difference formula", five rows of table 1: L1 a1
# b1 L2 a2 b2 dE.
SHARMA = np.array(
    [
        [50.0000, 2.6772, -79.7751, 50.0000, 0.0000, -82.7485, 2.0425],
        [50.0000, 3.1571, -77.2803, 50.0000, 0.0000, -82.7485, 2.8615],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0010, 7.1792],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0011, 7.2195],
        [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
    ]
)


def test_ciede2000_gives_the_published_differences():
    difference = measures.ciede2000(SHARMA[:, :3], SHARMA[:, 3:6])
    np.testing.assert_allclose(difference, SHARMA[:, 6], atol=5e-5)
    np.testing.assert_allclose(
        measures.ciede2000(SHARMA[:, 3:6], SHARMA[:, :3]), difference, atol=1e-9
    )


@pytest.mark.slow
def test_without_scikit_image_the_line_that_installs_it_is_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "skimage.color", None)
    with pytest.raises(
        DeviceError,
        match=r"CIEDE2000 needs .*skimage.*: pip install "
        r"'stereo-seecolor\[evaluation\]'$",
    ):
        measures.ciede2000(SHARMA[:, :3], SHARMA[:, 3:6])


def test_ciede2000_agrees_with_opencv_lab_and_color_science():
    from colour.difference.delta_e import delta_E_CIE2000  # takes a second

    rng = np.random.default_rng(4)
    lab = rng.uniform([0, -80, -80], [100, 80, 80], (500, 3))
    other = rng.uniform([0, -80, -80], [100, 80, 80], (500, 3))
    np.testing.assert_allclose(
        measures.ciede2000(lab, other), delta_E_CIE2000(lab, other), atol=1e-9
    )


def test_lab_agrees_with_opencv():
    import cv2

    linear = np.random.default_rng(0).uniform(0, 1, (50, 1, 3)).astype(np.float32)
    opencv = cv2.cvtColor(linear, cv2.COLOR_LRGB2Lab)
    # OpenCV interpolates in a table
    np.testing.assert_allclose(measures.lab_from_linear(linear), opencv, atol=0.2)


@pytest.mark.slow
@given(st.floats(0.01, 10), st.lists(st.floats(0.01, 1), min_size=3, max_size=3))
def test_psi_does_not_see_exposure_and_equals_the_papers_formula(
    exposure: float, color: list[float]
):
    pixel = np.array(color)
    psi = measures.gray_angle_deg(pixel * exposure)
    paper = np.degrees(np.arccos(np.minimum(pixel.sum() / np.sqrt(3 * (pixel**2).sum()), 1)))
    assert psi == pytest.approx(paper, abs=1e-5)


def test_a_blown_out_target_reads_zero_and_says_so():
    score = measures.score_neutral(np.ones((10, 3)))
    assert score.psi_deg == pytest.approx(0, abs=1e-9)
    assert score.clipped_fraction == 1
    assert score.pixels == 10


def test_unknown_and_black_pixels_take_part_in_nothing():
    gray, unknown, black = [0.4, 0.4, 0.4], [np.nan, 0.2, 0.9], [0.0, 0.0, 0.0]
    score = measures.score_neutral(np.array([gray, unknown, black]))
    assert score.psi_deg == pytest.approx(0, abs=1e-9)
    assert score.pixels == 2
    assert np.isnan(measures.score_neutral(np.zeros((0, 3))).psi_deg)
    assert measures.score_truth(np.full((4, 3), np.nan), np.full((4, 3), 0.5)).pixels == 0


def scene(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.uniform(0.1, 0.8, (40, 50, 3)), np.linspace(1, 5, 2000).reshape(40, 50)


def test_truth_scores_itself_perfectly():
    truth, range_m = scene(np.random.default_rng(1))
    score = measures.score_truth(truth, truth, range_m)
    assert score.angle_deg == pytest.approx(0, abs=1e-6)
    assert score.ciede2000 == pytest.approx(0, abs=1e-6)
    assert score.range_consistency == pytest.approx(1)
    assert score.pixels == 2000


def test_a_gain_a_channel_is_seen_before_gains_and_gone_after():
    truth, range_m = scene(np.random.default_rng(1))
    score = measures.score_truth(truth * [0.5, 1.0, 0.9], truth, range_m)
    assert score.angle_deg > 8
    assert score.angle_after_gains_deg == pytest.approx(0, abs=1e-6)
    assert score.range_consistency == pytest.approx(1)


def test_exposure_alone_is_no_color_error():
    truth, _ = scene(np.random.default_rng(1))
    darker = encode_srgb(0.4 * decode_srgb(truth))
    assert measures.score_truth(darker, truth).ciede2000 == pytest.approx(0, abs=1e-6)


def test_red_lost_with_range_is_a_range_inconsistency():
    truth, range_m = scene(np.random.default_rng(1))
    bluer = truth * np.exp(-np.array([0.3, 0, 0]) * range_m[..., None])
    expected = np.exp(-0.3 * (4.333 - 1.667))  # medians of the outer thirds
    assert measures.score_truth(
        bluer, truth, range_m, darkest=0
    ).range_consistency == pytest.approx(expected, rel=0.02)
    assert measures.range_consistency(bluer, None, range_m) < 0.7
