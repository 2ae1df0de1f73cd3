"""Keys of results: the content decides, and nothing of how it is printed."""

from dataclasses import dataclass

import numpy as np

from stereo_seecolor.files.keys import content_key


@dataclass(frozen=True)
class Part:
    numbers: np.ndarray


def test_long_arrays_that_differ_in_the_middle_differ() -> None:
    one = np.zeros(5000)
    other = one.copy()
    other[2500] = 1
    assert content_key(one) != content_key(other) == content_key(other.copy())
    assert content_key(Part(one)) != content_key(Part(other))
    assert (
        content_key(one) != content_key(one.astype(np.float32)) != content_key(one.reshape(50, 100))
    )


def test_how_numpy_prints_does_not_matter() -> None:
    parts = (np.float32(1 / 3), np.arange(3) / 7, Part(np.arange(4) / 3), {"a": np.int64(3)})
    key = content_key(*parts)
    with np.printoptions(legacy="1.13", precision=2):
        assert content_key(*parts) == key
