"""Arrays are read from files by several threads at once."""

import gc
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.files.raw_arrays import load_array, load_arrays, read_arrays, write_arrays


class Garbage:
    """Goes when garbage is collected, and lets other threads go on meanwhile."""

    def __init__(self) -> None:
        self.itself = self

    def __del__(self) -> None:
        time.sleep(0)


@pytest.fixture
def frequent_collection():
    """Of garbage, also while a header is parsed."""
    before = gc.get_threshold()
    gc.set_threshold(60, 1, 1)
    yield
    gc.set_threshold(*before)


@pytest.mark.slow
def test_threads_read_arrays_while_garbage_is_collected(
    tmp_path: Path, frequent_collection: None
) -> None:
    # a long header: much to parse
    content = np.zeros(3, [(f"field{number}", np.float32) for number in range(40)])
    np.save(tmp_path / "one.npy", content)
    np.savez(tmp_path / "some.npz", content=content)
    write_arrays(tmp_path / "raw", [content])

    def read(_: int) -> bool:
        Garbage(), Garbage(), Garbage()
        found = (
            load_array(tmp_path / "one.npy"),
            load_arrays(tmp_path / "some.npz")["content"],
            read_arrays(tmp_path / "raw", 1),
        )
        return found[2] is not None and all(
            np.array_equal(one, content) for one in (found[0], found[1], found[2][0])
        )

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(read, range(1000)))
