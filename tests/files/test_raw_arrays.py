"""Arrays kept as they are between the passes of a command."""

from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.files.raw_arrays import read_arrays, write_arrays

ARRAYS = [
    np.array(["a frame"]),
    np.array(np.nan),
    np.arange(15, dtype=np.uint8).reshape(5, 3),
    np.ones((3, 5), np.float32),
    np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    np.zeros((0, 3)),
    np.ones(7, np.bool_),
]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "arrays.raw"
    write_arrays(path, ARRAYS)
    return path


def test_arrays_come_back_as_they_were_for_compiled_code(file: Path) -> None:
    found = read_arrays(file, len(ARRAYS))
    assert found is not None
    for array, back in zip(ARRAYS, found, strict=True):
        np.testing.assert_array_equal(array, back)
        assert back.dtype == array.dtype
        assert back.flags.aligned
        assert back.flags.writeable


def test_what_is_written_into_an_array_stays_in_memory_and_a_deleted_file_is_still_read(
    file: Path,
) -> None:
    first = read_arrays(file, len(ARRAYS))
    assert first is not None
    first[2][:] = 99
    again = read_arrays(file, len(ARRAYS))
    file.unlink()
    assert again is not None
    np.testing.assert_array_equal(again[2], ARRAYS[2])


@pytest.mark.parametrize("kept", [0, 50, 300, -1])
def test_a_file_that_was_cut_holds_nothing(file: Path, kept: int) -> None:
    file.write_bytes(file.read_bytes()[:kept])
    assert read_arrays(file, len(ARRAYS)) is None


def test_more_arrays_than_were_written_are_not_there(file: Path) -> None:
    assert read_arrays(file, len(ARRAYS) + 1) is None
    assert read_arrays(file.with_name("never written"), 1) is None
