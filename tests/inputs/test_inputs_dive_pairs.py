"""Dives whose sides are cut into many folders, and images that show both sides."""

from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import make_files
from PIL import Image

from calibration.verification.mistake_table import EXCHANGE
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.live.sources import live_source
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.listing import folders_of, list_images
from stereo_seecolor.inputs.sides import find_sides

RNG = np.random.default_rng(0)


HOURS = [
    f"{hour}/{side}/{number}.png"
    for hour in ("9h", "10h")
    for side in ("left", "right")
    for number in (2, 10)
]


def test_a_pattern_takes_the_folders_of_each_hour(tmp_path: Path) -> None:
    root = make_files(tmp_path, *HOURS, "11h/left/2.png", "logs/nav.txt", ".old/left/2.png")
    found = pair_sides(root / "*/left", root / "*/right", InputConfig())
    assert [pair.name for pair in found.pairs] == ["9h_2", "9h_10", "10h_2", "10h_10"]
    assert all(
        pair.left.parts[-3:] == (*pair.name.split("_")[:1], "left", pair.right.name)
        for pair in found.pairs
    )
    assert [(file.path, file.reason) for file in found.unpaired] == [
        (root / "11h/left/2.png", "there is no right folder 11h")
    ]
    assert "the same file names occur in each of 2 folders a side" in found.notes[0]
    assert folders_of(root / "*/left") == (root / "9h/left", root / "10h/left", root / "11h/left")


def test_names_that_go_on_are_kept(tmp_path: Path) -> None:
    root = make_files(tmp_path, "a/left/1.png", "a/right/1.png", "b/left/2.png", "b/right/2.png")
    assert [
        pair.name for pair in pair_sides(root / "?/left", root / "?/right", InputConfig()).pairs
    ] == ["1", "2"]


@pytest.mark.parametrize(
    ("left", "right", "files"),
    [
        (
            "t*_left",
            "t*_right",
            ["t1_left/1.png", "t2_left/1.png", "t1_right/1.png", "t2_right/1.png"],
        ),
        ("*/*_L.png", "*/*_R.png", ["t1/1_L.png", "t1/1_R.png", "t2/1_L.png", "t2/1_R.png"]),
        ("left", "right", ["left/t1/1.png", "left/t2/1.png", "right/t1/1.png", "right/t2/1.png"]),
        (
            "*/left.png",
            "*/right.png",
            ["t1/left.png", "t1/right.png", "t2/left.png", "t2/right.png"],
        ),
    ],
)
def test_folders_of_each_transect(tmp_path: Path, left: str, right: str, files: list[str]) -> None:
    root = make_files(tmp_path, *files)
    pairs = pair_sides(root / left, root / right, InputConfig()).pairs
    assert [pair.name[:3] for pair in pairs] == ["t1_", "t2_"]
    assert all(
        pair.name[:2] in str(pair.left) and pair.name[:2] in str(pair.right) for pair in pairs
    )


def test_times_that_begin_anew_are_none_of_the_dive(tmp_path: Path) -> None:
    root = make_files(
        tmp_path,
        *(f"{hour}/{side}/1000000000.500.png" for hour in "ab" for side in ("left", "right")),
    )
    assert [
        pair.timestamp_s
        for pair in pair_sides(root / "*/left", root / "*/right", InputConfig()).pairs
    ] == [None, None]


def test_patterns_that_fit_nothing_or_both_sides(tmp_path: Path) -> None:
    root = make_files(tmp_path, *HOURS)
    with pytest.raises(
        InputError,
        match=r"matches folders of both sides \(9h_left, 9h_right.*write one side's name",
    ):
        list_images(root / "*/*", "left images")
    with pytest.raises(
        InputError, match=r"\*/links: no folder of images, and no image, in .* fits this pattern"
    ):
        list_images(root / "*/links", "left images")


@pytest.mark.slow
def test_inspect_says_how_to_take_all_hours(tmp_path: Path) -> None:
    root = make_files(tmp_path, *HOURS)
    assert find_sides([root]).together == (root / "*/left", root / "*/right")
    assert find_sides([make_files(root, "x/y/left/1.png")]).together is None


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_both_sides_in_each_image(tmp_path: Path, axis: int, dtype: type) -> None:
    sides = RNG.integers(0, np.iinfo(dtype).max, (2, 24, 30, 3)).astype(dtype)
    both = np.concatenate(list(sides), axis=axis)
    assert cv2.imwrite(str(tmp_path / "7.png"), both[..., ::-1])
    assert find_sides([tmp_path]).left == find_sides([tmp_path]).right == tmp_path
    for config, order in (
        (InputConfig(), sides),
        (InputConfig(right_half_first=True), sides[::-1]),
    ):
        (pair,) = pair_sides(tmp_path, tmp_path, config).pairs
        frame = FrameReader(config).read(pair)
        assert pair.name == "7"
        np.testing.assert_array_equal([frame.left, frame.right], order)
    assert "change input.right_half_first" in EXCHANGE


def test_halves_keep_what_the_camera_recorded(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x829A] = 0.004
    Image.fromarray(np.zeros((8, 32, 3), np.uint8)).save(tmp_path / "1.jpg", exif=exif)
    (pair,) = pair_sides(tmp_path, tmp_path, InputConfig()).pairs
    assert FrameReader(InputConfig()).capture(pair.left).exposure_s == pytest.approx(0.004)


def test_images_that_cannot_be_halved(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((8, 33), np.uint8))
    (pair,) = pair_sides(tmp_path, tmp_path, InputConfig()).pairs
    with pytest.raises(InputError, match=r"1\.png: is 33 px wide, an odd number"):
        FrameReader(InputConfig()).read(pair)


def test_live_refuses_one_folder_as_both_sides(tmp_path: Path) -> None:
    with ExitStack() as stack, pytest.raises(InputError, match="is --left and --right"):
        live_source(str(tmp_path), str(tmp_path), InputConfig(), stack)
