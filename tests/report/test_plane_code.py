"""What the page's scripts hold comes out again, in few bytes."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from plane_decoder import bytes_of, decoded, script_values

from stereo_seecolor.report.plane_code import UNKNOWN, coded
from stereo_seecolor.report.templates import script

RNG = np.random.default_rng(4)


@pytest.mark.parametrize(
    "content",
    [*map(RNG.bytes, range(4)), RNG.bytes(1001), np.arange(1 << 16, dtype="<u2").tobytes()],
)
def test_bytes_of_a_script_come_out_again_beside_text_of_any_kind(
    content: bytes, tmp_path: Path
) -> None:
    name = 'é"{"":0}\u2028'
    (tmp_path / "a.js").write_bytes(script("mesh", name, {"a": content, "b": [1.5, content]}))
    found_name, found = script_values(tmp_path / "a.js")
    assert found_name == name
    assert bytes_of(found["a"]) == bytes_of(found["b"][1]) == content


def test_a_script_without_bytes_is_ascii() -> None:
    assert script("map", {"é": None}) == b'seecolor.map({"\\u00e9":null});\n'


@pytest.mark.parametrize(
    "codes",
    [
        np.zeros((0, 0), np.int64),
        np.array([[65535]]),
        np.full((9, 1), 3),
        RNG.integers(0, 2, (1, 40)),
        RNG.integers(0, 65536, (30, 20)),
        np.where(RNG.random((30, 20)) < 0.1, 65535, RNG.integers(900, 904, (30, 20))),
    ],
)
def test_whole_numbers_come_out_again(codes: NDArray[np.int64]) -> None:
    np.testing.assert_array_equal(decoded(coded(codes), codes.shape), codes)


def test_smooth_numbers_take_the_bits_of_their_noise_and_unknown_ones_hardly_any() -> None:
    y, x = np.mgrid[:60, :80]
    noise = RNG.normal(0, 1, x.shape)
    codes = np.rint(900 + 0.3 * x + 0.2 * y + noise).astype(int)
    codes[:, 40:] = UNKNOWN
    content = coded(codes)
    np.testing.assert_array_equal(decoded(content, codes.shape)[:, :40], codes[:, :40])
    bits = 8 * len(content) / (codes >= 0).sum()
    # white noise of that width has 2.05 bits; a prediction from noisy neighbors adds its own
    assert 2.05 < bits < 3.2
