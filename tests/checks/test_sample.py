"""The images that several checks look at are decoded once for all of them."""

from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import REEF

from stereo_seecolor.checks.dive import IMAGE_CHECKS
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.verdict import verdict_of
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs import images
from stereo_seecolor.inputs.pairing import Pair


@pytest.fixture
def decodings(monkeypatch: pytest.MonkeyPatch) -> Counter[Path]:
    """How many times each file was decoded."""
    found, decoded = Counter[Path](), images.decoded

    def counted(content: bytes, path: Path, flags: int) -> object:
        found[path] += 1
        return decoded(content, path, flags)

    monkeypatch.setattr(images, "decoded", counted)
    return found


def test_images_whose_colors_are_compared_are_decoded_once(decodings: Counter[Path]) -> None:
    pairs = [
        Pair(left.stem, left, REEF / "right" / left.name)
        for left in sorted((REEF / "left").iterdir())
    ]
    seen = DiveImages.with_colors(pairs, RunConfig())
    assert set(decodings.values()) == {1}
    assert [path.parent.name for path in decodings].count("left") == 5
    assert [path.parent.name for path in decodings].count("right") == 3
    assert verdict_of(IMAGE_CHECKS, seen).notes == ()
    # the mosaic is looked for in all pixels, of the first pair alone where there is none
    again = [path for path, times in decodings.items() if times > 1]
    assert again == [pairs[0].left, pairs[0].right]


def test_images_that_cannot_be_read_are_left_to_the_checks(tmp_path: Path) -> None:
    """Which go on without their pair; results are those of images read one by one."""
    gray = np.full((40, 60, 3), 90, np.uint8)
    sides = {"left": gray, "right": np.add(gray, [0, 30, 60]).astype(np.uint8)}
    pairs = []
    for number in range(3):
        paths = [tmp_path / side / f"{number}.png" for side in sides]
        for path in paths:
            path.parent.mkdir(exist_ok=True)
            cv2.imwrite(str(path), sides[path.parent.name])
        pairs.append(Pair(f"{number}", *paths))
    pairs[1].right.write_bytes(b"no picture")
    one_by_one, together = (
        verdict_of(IMAGE_CHECKS, of(pairs, RunConfig()))
        for of in (DiveImages, DiveImages.with_colors)
    )
    assert together == one_by_one
    assert together.wrong == {"colors"}
