"""Pixels kept between the passes of a run: the same in memory, in files and read again; bounded,
and gone afterwards.
"""

import pickle
from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.records import Image
from stereo_seecolor.run_folder import kept_pixels
from stereo_seecolor.run_folder.kept_pixels import FramePixels, KeptPixels, KeptPixelsLimits
from stereo_seecolor.run_folder.layout import SCRATCH, STATE, state

RNG = np.random.default_rng(4)
SIZE = 20 * 30 * (3 + 4 + 1)


def pixels() -> FramePixels:
    image: Image = RNG.integers(0, 255, (20, 30, 3), dtype=np.uint8)
    return FramePixels(
        image, RNG.uniform(1, 2, (20, 30)).astype(np.float32), np.ones((20, 30), bool)
    )


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KeptPixels:
    """Two frames fit into memory."""
    monkeypatch.setattr(
        kept_pixels, "LIMITS", KeptPixelsLimits(memory_bytes=2 * SIZE, free_disk_bytes=0)
    )
    (tmp_path / STATE).mkdir()
    return KeptPixels(tmp_path)


def test_what_does_not_fit_into_memory_comes_back_from_files(
    kept: KeptPixels, tmp_path: Path
) -> None:
    frames = {f"{i}": pixels() for i in range(4)}
    for name, frame in frames.items():
        kept.keep(name, "key", frame)
    assert len(list(state(tmp_path, SCRATCH).iterdir())) == 2
    for name, frame in frames.items():
        found = kept.find(name, "key")
        assert found is not None
        np.testing.assert_array_equal(found.image, frame.image)
        assert (found.range_m is None) == (name in "23")
    assert kept.find("0", "another key") is None
    kept.clear()
    assert kept.find("0", "key") is None
    assert not state(tmp_path, SCRATCH).exists()


def test_dropping_a_frame_makes_room(kept: KeptPixels, tmp_path: Path) -> None:
    for name in "01":
        kept.keep(name, "key", pixels())
    kept.drop("0", "key")
    kept.keep("2", "key", pixels())
    assert kept.find("0", "key") is None
    assert not state(tmp_path, SCRATCH).exists()


def test_a_removed_file_is_not_kept(kept: KeptPixels, tmp_path: Path) -> None:
    for name in "012":
        kept.keep(name, "key", pixels())
    next(state(tmp_path, SCRATCH).iterdir()).unlink()
    assert kept.find("2", "key") is None


def test_a_full_disk_keeps_nothing_on_it(
    kept: KeptPixels, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        kept_pixels, "LIMITS", KeptPixelsLimits(memory_bytes=0, free_disk_bytes=1 << 62)
    )
    kept.keep("0", "key", pixels())
    assert kept.find("0", "key") is None


def test_another_process_of_this_machine_finds_files_and_adds_to_them(
    kept: KeptPixels, tmp_path: Path
) -> None:
    frames = {name: pixels() for name in "0123"}
    copy = pickle.loads(pickle.dumps(kept))
    for name in "012":
        kept.keep(name, "key", frames[name])
    copy.keep("3", "key", frames["3"])
    for one, name in ((copy, "2"), (kept, "3")):
        found = one.find(name, "key")
        assert found is not None
        np.testing.assert_array_equal(found.image, frames[name].image)
    assert copy.find("0", "key") is None  # in the memory of the first
    copy.drop("2", "key")
    assert kept.find("2", "key") is None
    kept.clear()
    assert not state(tmp_path, SCRATCH).exists()


def test_another_machine_keeps_nothing(kept: KeptPixels, tmp_path: Path) -> None:
    copy = KeptPixels.on_worker(tmp_path, "another machine")
    copy.keep("0", "key", pixels())
    assert copy.find("0", "key") is None
    assert not state(tmp_path, SCRATCH).exists()


def test_half_a_file_is_not_kept(kept: KeptPixels, tmp_path: Path) -> None:
    for name in "012":
        kept.keep(name, "key", pixels())
    (file,) = state(tmp_path, SCRATCH).iterdir()
    file.write_bytes(file.read_bytes()[:-10])
    assert kept.find("2", "key") is None


def test_a_part_of_a_larger_block_does_not_keep_the_block(kept: KeptPixels) -> None:
    block = RNG.uniform(1, 2, (6, 20, 30)).astype(np.float32)
    kept.keep("0", "key", FramePixels(pixels().image, block[4]))
    found = kept.find("0", "key")
    assert found is not None
    assert found.range_m is not None
    assert not np.shares_memory(found.range_m, block)
    np.testing.assert_array_equal(found.range_m, block[4])
