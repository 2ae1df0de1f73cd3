"""The torch path, which CUDA takes, against the compiled loops: equal on whatever device torch has
here.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.render import torch_apply
from stereo_seecolor.color.render.display import display
from stereo_seecolor.color.render.water_gains import gains
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.color.table.range_bins import VALUE_BINS, range_bits
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.device.color import count

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


def frame(depth):
    rng = np.random.default_rng(depth)
    image = rng.integers(0, 2**depth, (41, 63, 3)).astype(np.uint8 if depth == 8 else np.uint16)
    range_m = rng.uniform(0.05, 40, (41, 63)).astype(np.float32)
    range_m[rng.random((41, 63)) < 0.2] = rng.choice([np.nan, np.inf, -np.inf, 0, -1])
    return image, range_m


def on(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(array).to(DEVICE)


@pytest.mark.slow
@pytest.mark.parametrize("depth", [8, 16])
def test_tables_are_equal(depth):
    image, range_m = frame(depth)
    table = measure(image, range_m)
    counts, offset_sum = (
        part.cpu().numpy() for part in count(on(image), on(range_m), VALUE_BINS[depth])
    )
    assert np.array_equal(counts, table.counts)
    assert np.array_equal(offset_sum, table.offset_sum)


MATRIX = np.array([[1.4, -0.3, -0.1], [-0.2, 1.5, -0.3], [0.05, -0.45, 1.4]])


@pytest.mark.slow
@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("encoding", ["srgb", "as-is"])
@pytest.mark.parametrize(("highlights", "matrix"), [(1.0, None), (3.0, None), (3.0, MATRIX)])
def test_corrections_are_equal(depth, encoding, highlights, matrix):
    image, range_m = frame(depth)
    corrector = Corrector(ColorConfig(input_encoding=encoding))
    table = corrector.measure(image, range_m)
    water = corrector.fit(table)
    by_range = gains(
        water if matrix is None else replace(water, matrix=matrix), corrector.config, 1.3
    )
    bits, flat, shown = (
        range_bits(range_m),
        image.reshape(-1, 3),
        display(depth, encoding, highlights),
    )
    camera = np.random.default_rng(0).permutation(flat)  # other pixels are clipped
    bright = np.maximum(flat, camera)
    on_cores, clipped = torch_apply.on_processor(flat, bits, by_range, shown, bright)
    pixels = on(flat.astype(np.int32) if depth == 16 else flat)
    *in_torch, also = torch_apply.apply_on(
        pixels,
        on(bright if depth == 8 else bright.astype(np.int32)),
        on(bits),
        by_range,
        shown,
        depth == 8,
    )
    values, unknown, unrecoverable = (part.cpu().numpy() for part in in_torch)
    # CUDA, products of matrices and some processors fuse a product and a sum: 1 of 7749 values of
    # 16 bits is rounded otherwise
    most = 1 if DEVICE.type == "cuda" or matrix is not None or depth == 16 else 0
    off = np.abs(on_cores.image.astype(int) - values)
    assert off.max() <= most
    assert DEVICE.type == "cuda" or matrix is not None or (off > 0).mean() < 0.001
    assert np.array_equal(on_cores.unknown, unknown)
    assert np.array_equal(on_cores.unrecoverable, unrecoverable)
    assert clipped == pytest.approx(also, abs=1e-3 * most)
