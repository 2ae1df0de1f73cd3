"""Which folders or videos are the two sides of a dive."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import make_files

from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.image_facts import image_facts
from stereo_seecolor.inputs.sides import find_sides, video_of

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("files", "left", "right", "guessed"),
    [
        (["left/1.png", "right/1.png"], "left", "right", False),
        (["R/1.png", "L/1.png"], "L", "R", False),
        (
            ["dive/cam0/data/1.png", "dive/cam1/data/1.png"],
            "dive/cam0/data",
            "dive/cam1/data",
            False,
        ),
        (
            ["t/auv0/rgb/cam1/data/1.png", "t/auv0/rgb/cam0/data/1.png"],
            "t/auv0/rgb/cam0/data",
            "t/auv0/rgb/cam1/data",
            False,
        ),
        (["L/1.png", "R/1.png", "out/page/a/b/c/1.png"], "L", "R", False),
        (["port/1.png", "star/1.png", "thumbs/x.png"], "port", "star", True),
        (
            [f"set_{i}/{side}_{i + 7}.tif" for i in range(3) for side in ("LFT", "RGT")],
            "*/LFT_*.tif",
            "*/RGT_*.tif",
            False,
        ),
        (["RGT/1.png", "LFT/1.png"], "LFT", "RGT", False),
        (["droite/1.png", "gauche/1.png"], "gauche", "droite", False),
        (["Rechte Kamera/1.png", "Linke Kamera/1.png"], "Linke Kamera", "Rechte Kamera", False),
        (["left/1.png", "right/1.png", "left/raw/2.png", "notes/3.png"], "left", "right", False),
        (["a/.hidden/1.png", "L/1.png", "R/1.png"], "L", "R", False),
        (
            ["left1.jpg", "right1.jpg", "left12.jpg", "right12.jpg"],
            "left*.jpg",
            "right*.jpg",
            False,
        ),
        (
            ["PR_2_LC16.png", "PR_2_RM16.png", "PR_13_LC16.png", "PR_13_RM16.png"],
            "PR_*_LC*.png",
            "PR_*_RM*.png",
            False,
        ),
        (["cam0_001.png", "cam1_001.png"], "cam0_*.png", "cam1_*.png", False),
        (["left.png", "right.png", "disparity.png"], "left.png", "right.png", False),
        (
            ["left/10h/1.png", "left/11h/2.png", "right/10h/1.png", "right/11h/2.png"],
            "left",
            "right",
            False,
        ),
        (["a/x/1.png", "a/y/2.png", "b/x/1.png", "b/y/2.png"], "a", "b", True),
        (
            ["10h/left/1.png", "10h/right/1.png", "11h/left/2.png", "11h/right/2.png"],
            "10h/left",
            "10h/right",
            False,
        ),
        (["L.mp4", "R.mp4"], "L.mp4", "R.mp4", False),
        (["GH01.mp4", "GH02.mp4"], "GH01.mp4", "GH02.mp4", True),
        (["both.mp4"], "both.mp4", "both.mp4", False),
    ],
)
def test_sides_in_one_folder(
    tmp_path: Path, files: list[str], left: str, right: str, guessed: bool
) -> None:
    found = find_sides([make_files(tmp_path, *files)])
    assert (found.left, found.right, found.guessed) == (tmp_path / left, tmp_path / right, guessed)


def test_folders_of_the_same_names_are_said(tmp_path: Path) -> None:
    root = make_files(
        tmp_path,
        "10h/left/1.png",
        "10h/right/1.png",
        "11h/left/2.png",
        "11h/right/2.png",
        "notes/3.png",
    )
    assert find_sides([root]).others == (root / "11h/left", root / "11h/right")
    assert find_sides([root / "10h"]).others == ()


def test_sides_given_as_two_folders(tmp_path: Path) -> None:
    make_files(tmp_path, "rc/1.png", "lc/1.png")
    assert find_sides([tmp_path / "rc", tmp_path / "lc"]).left == tmp_path / "lc"


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["notes.txt"], r"no images \(.*\) and no videos were found"),
        (
            ["dive/1.WEBP", "dive/2.webp"],
            "2 files of a kind that is not read [(].webp[)]: convert them to PNG",
        ),
        (
            ["left/1.png", "left/2.png"],
            "left: holds the left images only: give the folder of the other side",
        ),
        (
            ["1.png", "2.png"],
            "holds all images in one folder, and no name shows .*: move the left and the right",
        ),
        (["a/x.png", "b/y2.png"], "no left image matches a right one by name or time stamp"),
        (["a/1.png", "a/1.jpg", "b/1.png"], "several files are called '1'"),
        (["a/x.png", "b/y2.png", "c/z3.png"], "contain pairs: give the two sides of one dive"),
        (["1.mp4", "2.mp4", "3.mp4"], "3 videos were found"),
    ],
)
def test_no_two_sides(tmp_path: Path, files: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        find_sides([make_files(tmp_path, *files)])


def test_a_missing_place(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere: does not exist"):
        find_sides([tmp_path / "nowhere"])


SMOOTH = cv2.resize(
    RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8), (96, 64), interpolation=cv2.INTER_CUBIC
)


def mosaic() -> np.ndarray:
    pixels = np.empty((64, 96), np.uint8)
    for row, column, scale in ((0, 0, 1.0), (0, 1, 0.7), (1, 0, 0.7), (1, 1, 0.3)):
        pixels[row::2, column::2] = SMOOTH[row::2, column::2, 0] * scale
    return pixels


@pytest.mark.parametrize(
    ("pixels", "kind", "bits", "used_bits"),
    [
        (SMOOTH, "color", 8, 8),
        (SMOOTH[..., 0], "monochrome", 8, 8),
        (np.repeat(SMOOTH[..., :1], 3, axis=2), "monochrome", 8, 8),
        (mosaic(), "mosaic", 8, 8),
        (SMOOTH.astype(np.uint16) * 16 + 15, "color", 16, 12),
        (SMOOTH.astype(np.uint16) * 16, "color", 16, 16),  # dark, of 12 bits that were shifted
        (SMOOTH.astype(np.uint16) * 257, "color", 16, 16),
    ],
)
def test_kinds_of_images(
    tmp_path: Path, pixels: np.ndarray, kind: str, bits: int, used_bits: int
) -> None:
    assert cv2.imwrite(str(tmp_path / "a.png"), pixels)
    found = image_facts(tmp_path / "a.png")
    assert (found.kind, found.bits, found.used_bits, found.size) == (
        kind,
        bits,
        used_bits,
        (96, 64),
    )


@pytest.mark.parametrize("sides", [("left", "right"), ("b", "a")])
def test_sides_that_are_given_are_never_cut(tmp_path: Path, sides: tuple[str, str]) -> None:
    """A card has a folder of every 999 images: two folders of one side look like two sides."""
    for side in sides:
        for folder, numbers in (("100MEDIA", range(994, 1000)), ("101MEDIA", range(1, 7))):
            make_files(tmp_path, *(f"{side}/{folder}/DJI_{n:04d}.png" for n in numbers))
    found = find_sides([tmp_path / side for side in sides])
    assert {found.left, found.right} == {tmp_path / side for side in sides}
    if sides == ("left", "right"):
        assert found.left == tmp_path / "left"


def test_a_card_with_one_video_is_that_video(tmp_path: Path) -> None:
    names = ["GX010012.MP4", "GL010012.LRV", "GX010012.THM", "._GX010012.MP4"]
    make_files(tmp_path, *(f"left/DCIM/100GOPRO/{name}" for name in names))
    video = tmp_path / "left/DCIM/100GOPRO/GX010012.MP4"
    assert video_of(tmp_path / "left") == video_of(video) == video
    make_files(tmp_path, "two/a.mp4", "two/b.mp4", "images/a.png", "images/a.mp4")
    for name in ("two", "images", "nowhere"):
        assert video_of(tmp_path / name) == tmp_path / name


@pytest.mark.parametrize("name", ["{}.png", "{}_of_{}.png"])
def test_a_day_that_one_side_lacks_is_named(tmp_path: Path, name: str) -> None:
    """As left out where names come again each day, else as files without a partner."""
    for folder in ("port/day1", "stbd/day1", "port/day2"):
        (tmp_path / folder).mkdir(parents=True)
        for number in range(3):
            (tmp_path / folder / name.format(number, folder[-4:])).touch()
    sides = find_sides([tmp_path])
    left, others = ("port/day1", ["port/day2"]) if name == "{}.png" else ("port", [])
    assert (sides.left, sides.right) == (tmp_path / left, tmp_path / "stbd/day1")
    assert list(sides.others) == [tmp_path / other for other in others]
    assert not others or sides.together is None  # names that come again: no partner has one
