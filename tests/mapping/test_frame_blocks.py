"""Equations of frames in their sparse order give what the whole matrix gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from stereo_seecolor.mapping.track.frame_blocks import SIDE, FrameBlocks, Layout


def equations(joined: np.ndarray, seed: int) -> tuple[FrameBlocks, np.ndarray, np.ndarray]:
    """Of blocks that hang together as ``joined`` (N, N) says; the same as one matrix, and its right
    side.
    """
    rng, count = np.random.default_rng(seed), len(joined)
    blocks, whole, g = (
        Layout.of(csr_array(joined)).zeros(),
        np.zeros((SIDE * count,) * 2),
        rng.normal(size=SIDE * count),
    )
    for i, j in zip(*np.nonzero(np.tril(joined)), strict=True):
        both, J = sorted({i, j}), rng.normal(size=(20, 2 * SIDE))
        for a, first in enumerate(both):
            for b, second in enumerate(both[: a + 1]):
                H = J[:, SIDE * a : SIDE * (a + 1)].T @ J[:, SIDE * b : SIDE * (b + 1)]
                blocks.add(first, second, H)
                rows, columns = (slice(SIDE * k, SIDE * (k + 1)) for k in (first, second))
                whole[rows, columns] += H
                if first != second:
                    whole[columns, rows] += H.T
    for k in range(count):
        blocks.add_right(k, g[SIDE * k : SIDE * (k + 1)])
    return blocks, whole, g


@pytest.mark.slow
@settings(max_examples=30)
@given(
    count=st.integers(1, 30),
    reach=st.integers(1, 4),
    loops=st.integers(0, 2),
    seed=st.integers(0, 9),
)
def test_sparse_equations_give_what_the_whole_matrix_gives(
    count: int, reach: int, loops: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    joined = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) <= reach
    far = rng.integers(0, count, (loops, 2))
    joined[far[:, 0], far[:, 1]] = joined[far[:, 1], far[:, 0]] = True
    shuffled = rng.permutation(count)
    blocks, whole, g = equations(joined[shuffled][:, shuffled].astype(np.int32), seed)
    assert blocks.solve() == pytest.approx(
        np.linalg.solve(whole, g).reshape(-1, SIDE), rel=1e-6, abs=1e-9
    )
    inverse = np.linalg.inv(whole)
    own = [inverse[SIDE * k : SIDE * (k + 1), SIDE * k : SIDE * (k + 1)] for k in range(count)]
    assert blocks.covariances() == pytest.approx(np.array(own), rel=1e-6, abs=1e-9)


def test_a_long_track_takes_small_parts() -> None:
    order = np.random.default_rng(0).permutation(200)
    near = np.abs(np.subtract.outer(order, order)) <= 3
    layout = Layout.of(csr_array(near.astype(np.int32)))
    assert layout.size <= 6


def test_equations_that_say_too_little_are_refused() -> None:
    blocks = Layout.of(csr_array(np.eye(2, dtype=np.int32))).zeros()
    blocks.add(0, 0, np.eye(SIDE))
    with pytest.raises(np.linalg.LinAlgError):
        blocks.solve()
