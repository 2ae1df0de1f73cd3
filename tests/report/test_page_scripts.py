"""What the page's scripts hold comes out again, in few bytes."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from page_scripts import bytes_of, numbers_of, script_values

from stereo_seecolor.report.number_code import coded
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


@pytest.mark.parametrize("repeats", [False, True])
@pytest.mark.parametrize(
    "numbers",
    [
        np.zeros((0, 0), np.int64),
        np.array([[65535]]),
        RNG.integers(0, 2, (1, 40)).astype(bool),
        RNG.integers(0, 256, (9, 5)).astype(np.uint8),
        RNG.integers(-(2**22), 2**22, (30, 20)).T,
    ],
)
def test_whole_numbers_come_out_again(numbers: NDArray[np.integer], repeats: bool) -> None:
    np.testing.assert_array_equal(numbers_of(coded(numbers, repeats)), numbers.ravel())


def test_smooth_numbers_take_few_bits_beyond_those_of_their_noise() -> None:
    y, x = np.mgrid[:60, :80]
    codes = np.rint(900 + 0.3 * x + 0.2 * y + RNG.normal(0, 1, x.shape)).astype(int)
    # white noise of that width has 2.05 bits; the difference of two has half a bit more
    assert 2.5 < 8 * len(coded(codes)) / codes.size < 4.5
