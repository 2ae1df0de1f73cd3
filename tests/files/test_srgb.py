"""The one sRGB curve of the program."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo_seecolor.files.srgb import decode_srgb, decoding_slope, encode_srgb


@pytest.mark.parametrize(
    ("encoded", "light"),
    [(0, 0), (10 / 255, 0.003035), (118 / 255, 0.181164), (188 / 255, 0.502886), (1, 1)],
)
def test_values_of_the_standard(encoded, light):
    assert decode_srgb(np.array(float(encoded))) == pytest.approx(light, abs=1e-6)


@given(st.floats(-1, 4))
def test_round_trip_also_beyond_full_scale(light):
    assert decode_srgb(encode_srgb(np.array(light))) == pytest.approx(light, abs=1e-4)


def test_slope_is_the_derivative():
    encoded = np.linspace(0.001, 1, 500)
    slope = (decode_srgb(encoded + 1e-7) - decode_srgb(encoded - 1e-7)) / 2e-7
    away = np.abs(encoded - 0.04045) > 0.003
    np.testing.assert_allclose(decoding_slope(decode_srgb(encoded))[away], slope[away], rtol=1e-4)


def test_single_precision_stays_single():
    light = np.linspace(0, 1, 5, dtype=np.float32)
    assert (
        encode_srgb(light).dtype
        == decode_srgb(light).dtype
        == decoding_slope(light).dtype
        == np.float32
    )
