"""What one spot shows from several ranges corrects the attenuation that a fit of images gives."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.color_trend import SYSTEMATIC, ColorTrend, with_color_trend
from stereo_seecolor.files.srgb import LUMINANCE
from stereo_seecolor.records import Water

RANGE_M = 2.0
TRUTH = Water(*np.zeros((6, 3)), y=np.array([0.4, 0.15, 0.1]), x=np.zeros(3))
UNKNOWN = np.full(3, np.nan)


def fitted(
    y: tuple[float, float, float], error: NDArray[np.float64] = UNKNOWN, gamma_inf: float = 0.0
) -> Water:
    return replace(
        TRUTH,
        y=np.array(y),
        gamma_inf=np.full(3, gamma_inf),
        beta=np.full(3, 0.2),
        standard_errors={"y": error},
        white=np.ones(3),
    )


def trend_under(water: Water, error: float = 0.0) -> ColorTrend:
    """What a gray spot shows in this water, by a difference of ranges of its own."""
    step = 1e-4
    near, at, far = (
        0.2 * water.white * water.attenuation(np.array(range_m))
        + water.backscatter(np.array(range_m))
        for range_m in (RANGE_M * (1 - step), RANGE_M, RANGE_M * (1 + step))
    )
    power = np.log(far / near) / (2 * step)
    return ColorTrend(power - power.mean(), error, RANGE_M, at)


def brightness(water: Water, range_m: float) -> float:
    """Of a gray surface, corrected by this water: the logarithm of what luminance becomes."""
    return float(np.log(1 / (water.white * water.attenuation(np.array(range_m)))) @ LUMINANCE)


@pytest.mark.parametrize("gamma_inf", [0.0, 0.1])
def test_attenuation_that_is_not_known_is_that_of_the_spots(gamma_inf: float) -> None:
    truth = replace(TRUTH, gamma_inf=np.full(3, gamma_inf), beta=np.full(3, 0.2))
    water = fitted((0.7, 0.1, 0.2), gamma_inf=gamma_inf)
    found = with_color_trend(water, trend_under(truth))
    assert found.y[0] - found.y[1] == pytest.approx(0.25, abs=0.02)
    assert found.y[1] - found.y[2] == pytest.approx(0.05, abs=0.02)


def test_nothing_changes_at_the_trends_range_and_brightness_not_at_any() -> None:
    water = fitted((0.7, 0.1, 0.2))
    found = with_color_trend(water, trend_under(TRUTH))
    at = np.array(RANGE_M)
    assert found.white * found.attenuation(at) == pytest.approx(water.white * water.attenuation(at))
    assert brightness(found, 4.0) == pytest.approx(brightness(water, 4.0))


def test_two_measurements_are_weighted_by_their_variances() -> None:
    known = np.full(3, SYSTEMATIC / RANGE_M)
    every, half = (
        with_color_trend(fitted((0.7, 0.1, 0.2), error), trend_under(TRUTH)).y
        for error in (UNKNOWN, known)
    )
    assert half == pytest.approx((every + np.array([0.7, 0.1, 0.2])) / 2)
    exact = fitted((0.7, 0.1, 0.2), np.full(3, 1e-6))
    assert with_color_trend(exact, trend_under(TRUTH)).y == pytest.approx(exact.y, abs=1e-6)


def test_a_water_that_the_spots_agree_with_stays() -> None:
    water = replace(TRUTH, standard_errors={"y": np.full(3, 0.1)})
    assert with_color_trend(water, trend_under(water)).y == pytest.approx(water.y, abs=1e-4)
    assert with_color_trend(water, None) is water


def test_light_never_grows_with_range() -> None:
    water = replace(fitted((0.2, 0.2, 0.2)), w=np.array([-0.1, 0.0, 0.0]), v=np.full(3, 0.25))
    upward = ColorTrend(np.array([5.0, -2.5, -2.5]), 0.0, RANGE_M, np.full(3, 0.1))
    assert with_color_trend(water, upward).y[0] == pytest.approx(0.1)
