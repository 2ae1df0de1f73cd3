"""Moment tables hold all that the losses need: every pixel with a range, at its level and value,
exactly.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_seecolor.color.corrector import SAMPLING, Corrector
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_bins import RANGE_BINS, range_edges_m
from stereo_seecolor.errors import ColorError


def random_frame(seed, shape=(23, 17), depth=8):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 2**depth, (*shape, 3)).astype(np.uint8 if depth == 8 else np.uint16)
    range_m = rng.uniform(0.05, 40, shape).astype(np.float32)
    range_m[rng.random(shape) < 0.2] = rng.choice([np.nan, np.inf, -np.inf, 0, -1])
    return image, range_m


@given(st.integers(0, 2**32 - 1), st.sampled_from([8, 16]))
@settings(max_examples=20)
def test_counts_are_the_plain_histogram(seed, depth):
    image, range_m = random_frame(seed, depth=depth)
    table = measure(image, range_m)
    known = np.isfinite(range_m) & (range_m > 0)
    z = range_m[known].clip(0.125, np.nextafter(np.float32(32), np.float32(0)))
    level = np.searchsorted(range_edges_m(), z, side="right") - 1
    shift = 0 if depth == 8 else 4
    for channel in range(3):
        plain = np.zeros_like(table.counts[0])
        np.add.at(plain, (level, image[known][:, channel] >> shift), 1)
        assert np.array_equal(table.counts[channel], plain)
    sums = np.bincount(level, z.astype(np.float64), RANGE_BINS)
    occupied = table.pixels > 0
    assert np.allclose(
        table.range_m[occupied], (sums / np.maximum(table.pixels, 1))[occupied], rtol=1e-12
    )


def test_tables_add_and_subtract():
    image, range_m = random_frame(1)
    top, bottom, whole = (
        measure(image[:9], range_m[:9]),
        measure(image[9:], range_m[9:]),
        measure(image, range_m),
    )
    both = top + bottom
    assert np.array_equal(both.counts, whole.counts)
    assert np.array_equal(both.range_m, whole.range_m)
    assert np.array_equal((whole - top).counts, bottom.counts)
    assert np.allclose((whole - top).range_m, bottom.range_m, rtol=1e-12)
    assert np.array_equal((MomentTable.empty() + top).offset_sum, top.offset_sum)


def test_a_large_frame_is_measured_from_some_of_its_rows():
    image, range_m = random_frame(7, (1200, 900))
    table = Corrector().measure(image, range_m)
    assert np.array_equal(table.counts, measure(image[1::2], range_m[1::2]).counts)
    assert image[1::2, :, 0].size >= SAMPLING.pixels
    assert np.array_equal(
        measure(image, range_m, every=5).counts, measure(image[2::5], range_m[2::5]).counts
    )


def test_a_large_frame_with_few_known_ranges_is_measured_whole():
    image, range_m = random_frame(8, (1200, 900))
    range_m[:, 40:] = np.nan
    assert np.array_equal(
        Corrector().measure(image, range_m).counts, measure(image, range_m).counts
    )
    range_m[:] = np.nan
    range_m[0, 5] = 2.0
    assert Corrector().measure(image, range_m).pixels.sum() == 1


@pytest.mark.parametrize("depth", [8, 16])
def test_packed_and_unpacked_it_is_the_same(depth):
    table = measure(*random_frame(3, depth=depth))
    again = MomentTable.unpacked(table.packed())
    assert np.array_equal(again.counts, table.counts)
    assert np.array_equal(again.offset_sum, table.offset_sum)
    assert again.bit_depth == depth
    assert len(table.packed()) < 0.6 * table.counts.nbytes


def test_its_text_says_how_much_it_holds():
    table = measure(*random_frame(3, depth=16))
    assert repr(table).startswith(f"MomentTable({table.pixels.sum()} pixels, 16 bit, 0.")
    assert repr(MomentTable.empty()) == "MomentTable(0 pixels, 8 bit)"


def test_what_does_not_belong_together_is_named():
    image, range_m = random_frame(4)
    with pytest.raises(ColorError, match="must be the same size"):
        measure(image, range_m[:-1])
    with pytest.raises(ColorError, match="needs \\(H, W, 3\\)"):
        measure(image.astype(np.float32), range_m)


def test_tables_of_16_and_8_bits_add_as_8_bits():
    deep, range_m = random_frame(5, depth=16)
    shallow = (deep >> 8).astype(np.uint8)
    mixed = measure(deep, range_m) + measure(shallow, range_m)
    assert mixed.bit_depth == 8
    assert np.array_equal(mixed.counts, 2 * measure(shallow, range_m).counts)
    assert np.array_equal((mixed - measure(deep, range_m)).counts, measure(shallow, range_m).counts)
