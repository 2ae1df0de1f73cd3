"""JPEG images so strongly compressed that their colors are in blocks."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.checks.image_files import compression, jpeg_quality
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.pairing import Pair

IMAGE = np.random.default_rng(3).integers(0, 256, (40, 48, 3), np.uint8)


@pytest.mark.parametrize("quality", [20, 50, 60, 79, 85, 95, 100])
def test_the_quality_of_a_jpeg_is_read_from_its_tables(quality: int) -> None:
    content = cv2.imencode(".jpg", IMAGE, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    found = jpeg_quality(content)
    assert found is not None
    assert abs(found - quality) <= 1  # steps are whole numbers
    assert jpeg_quality(content[:30]) is None


@pytest.mark.parametrize(
    ("suffix", "quality", "said"), [(".jpg", 60, True), (".jpg", 90, False), (".png", 60, False)]
)
def test_strong_compression_is_named(tmp_path: Path, suffix: str, quality: int, said: bool) -> None:
    path = tmp_path / f"0001{suffix}"
    cv2.imwrite(str(path), IMAGE, [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else [])
    notes = compression(DiveImages([Pair("0001", path, path)], RunConfig())).notes
    assert bool(notes) == said
    assert all("0001.jpg is a JPEG of quality 60" in note for note in notes)


def test_nothing_is_said_of_what_cannot_be_read(tmp_path: Path) -> None:
    absent = Pair("0001", tmp_path / "0001.jpg", tmp_path / "0001.jpg")
    assert compression(DiveImages([absent], RunConfig())).notes == ()
    assert compression(DiveImages([], RunConfig())).notes == ()
