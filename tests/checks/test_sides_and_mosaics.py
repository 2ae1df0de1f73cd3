"""Left images without color, and mosaics of colors that were read one column or row off."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from stereo_seecolor.checks.channel_order import channel_order
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.sides_and_mosaics import gray_side, shifted_mosaic
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.pairing import Pair

REEF = Path(__file__).resolve().parents[2] / "data_samples" / "reef"
Picture = NDArray[np.uint8]


def dive(root: Path, left: list[Picture], right: list[Picture], suffix: str = ".png") -> DiveImages:
    """A dive of these pictures, BGR or gray."""
    pairs = []
    for number, (one, other) in enumerate(zip(left, right, strict=True)):
        places = [root / f"{side}{number:04d}{suffix}" for side in "lr"]
        for place, picture in zip(places, (one, other), strict=True):
            cv2.imwrite(str(place), picture)
        pairs.append(Pair(f"{number:04d}", *places))
    return DiveImages(pairs, RunConfig())


def pictures(side: str = "left", step: int = 5) -> list[Picture]:
    return [cv2.imread(str(path)) for path in sorted((REEF / side).iterdir())[::step]]


def gray(picture: Picture) -> Picture:
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_left_images_without_color_are_named(tmp_path: Path, suffix: str) -> None:
    left = [gray(picture) for picture in pictures()]
    found = gray_side(dive(tmp_path, left, pictures("right"), suffix))
    (note,) = found.notes
    assert found.wrong == {"colors"}
    assert "left images have no color" in note and "exchange --left and --right" in note
    of_a_monochrome_rig = gray_side(dive(tmp_path, left, left, suffix))
    assert not of_a_monochrome_rig.wrong
    assert "corrected images are gray" in of_a_monochrome_rig.notes[0]
    assert gray_side(dive(tmp_path, pictures(), left, suffix)).notes == ()
    assert gray_side(DiveImages([], RunConfig())).notes == ()


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_tint_is_no_color(tmp_path: Path, suffix: str) -> None:
    left = [
        np.clip(np.dstack([gray(picture)] * 3) * [1.1, 1.0, 0.7], 0, 255).astype(np.uint8)
        for picture in pictures()
    ]
    assert gray_side(dive(tmp_path, left, pictures("right"), suffix)).wrong == {"colors"}
    # water that takes all color but its own is seen by both sides
    assert gray_side(dive(tmp_path, left, left, suffix)).notes == ()


@pytest.mark.parametrize(("first", "last"), [(6, 11), (0, 3), (4, 7)])
def test_left_images_without_color_in_a_part_of_the_dive_are_named(
    tmp_path: Path, first: int, last: int
) -> None:
    left = pictures(step=1)
    left[first : last + 1] = [gray(picture) for picture in left[first : last + 1]]
    found = gray_side(dive(tmp_path, left, left))
    assert found.wrong == {"colors"}
    assert f"no color from l{first:04d}.png to l{last:04d}.png" in found.notes[0]


def mosaic(picture: Picture) -> Picture:
    """What a sensor of RGGB pixels would have stored."""
    result = picture[..., 1].copy()
    result[::2, ::2] = picture[::2, ::2, 2]
    result[1::2, 1::2] = picture[1::2, 1::2, 0]
    return result


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize(
    ("code", "named"),
    [
        (cv2.COLOR_BayerBG2BGR, False),
        (cv2.COLOR_BayerGR2BGR, True),  # one column off
        (cv2.COLOR_BayerGB2BGR, True),  # one row off
        (cv2.COLOR_BayerRG2BGR, False),  # red and blue exchanged: no lattice
    ],
)
def test_a_mosaic_that_was_read_one_off_is_named(
    code: int, named: bool, suffix: str, tmp_path: Path
) -> None:
    right = pictures("right")
    left = [cv2.cvtColor(mosaic(picture), code) for picture in pictures()]
    found = shifted_mosaic(dive(tmp_path, left, right, suffix))
    notes, wrong = found.notes, found.wrong
    assert wrong == ({"colors"} if named else frozenset())
    assert bool(notes) == named
    assert all(
        "as if a Bayer mosaic" in note and note.startswith("input: left images") for note in notes
    )


def test_true_colors_and_gray_are_no_mosaic(tmp_path: Path) -> None:
    one = pictures()
    magenta = [np.stack([p[..., 2], p[..., 1] // 2, p[..., 2]], axis=2) for p in one]
    for number, left in enumerate((one, [gray(p) for p in one], magenta)):
        (tmp_path / f"{number}").mkdir()
        assert shifted_mosaic(dive(tmp_path / f"{number}", left, left)).notes == ()


@pytest.mark.parametrize("last", [False, True])
def test_one_image_of_other_colors_is_named_without_a_claim_of_the_others(
    last: bool, tmp_path: Path
) -> None:
    left = pictures(step=1)
    place = 11 if last else 6
    left[place] = left[place][..., ::-1].copy()
    (note,) = channel_order(dive(tmp_path, left, left)).notes
    assert f"l{place:04d}.png: " in note and "the following images" not in note
    assert "another camera, light or scene" in note
