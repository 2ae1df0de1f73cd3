"""Medians of a mosaic's views against numpy's."""

import numpy as np

from stereo_seecolor.mapping.raster.medians import UNKNOWN, twice_medians


def test_medians_of_the_known_values_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    values = rng.integers(0, 256, (9, 400), dtype=np.uint8)
    values[:, ::2] //= 64  # many of the same
    seen = rng.random(values.shape) < rng.random(400)
    seen[0, :] = True
    wanted = [int(2 * np.median(column[known])) for column, known in zip(values.T, seen.T, strict=True)]
    bytes_a, bytes_b = np.empty((2, 400), np.uint8)
    twice = np.empty(400, np.int32)
    known = seen.sum(axis=0).astype(np.uint16)
    twice_medians(np.where(seen, values, UNKNOWN), known, bytes_a, bytes_b, np.empty(400, np.uint16), twice)
    np.testing.assert_array_equal(twice, wanted)
