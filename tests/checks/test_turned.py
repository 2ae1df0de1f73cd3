"""Images that EXIF turns otherwise than the others of their side."""

from pathlib import Path

import pytest
from PIL import Image
from small_dives import write_short_reef

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.checks.changes import find_change
from stereo_seecolor.commands.rig_loading import pairs_of
from stereo_seecolor.config import RunConfig


def save(path: Path, source: Path, tag: int, turned: bool = False) -> None:
    pixels = Image.open(source).convert("RGB")
    exif = Image.Exif()
    exif[0x0112] = tag
    (pixels.rotate(180) if turned else pixels).save(path, quality=95, exif=exif)


@pytest.fixture
def dive(tmp_path: Path):
    def make(tags: dict[str, dict[int, int]], upright: bool = False) -> Path:
        """Six pairs. tags: side -> number -> tag. upright: pixels are turned to look as before."""
        write_short_reef(tmp_path, range(6))
        for side in ("left", "right"):
            for number, source in enumerate(sorted((tmp_path / side).iterdir())):
                tag = tags.get(side, {}).get(number, 1)
                save(tmp_path / side / f"{number}.jpg", source, tag, upright and tag == 3)
                source.unlink()
        return tmp_path

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tags", "first"),
    [
        ({"right": {2: 3, 3: 3}}, "2.jpg (right): EXIF Orientation is 3, and 1"),
        ({"left": {1: 3}, "right": {1: 3}}, "1.jpg (left): EXIF Orientation is 3, and 1"),
        ({"left": {4: 6}}, "4.jpg (left): EXIF Orientation is 6, and 1"),
    ],
)
def test_pairs_turned_by_their_tag_are_named_and_left_out(dive, tags, first: str) -> None:
    root = dive(tags)
    images = RunConfig().input
    pairs = pairs_of(root / "left", root / "right", images).pairs
    rig = load_rig(root / "cam.yaml")
    found = find_change(Rectification.from_rig(rig), pairs, images)
    assert first in found.line
    assert found.is_rigid
    numbers = {number for side in tags.values() for number in side}
    assert found.odd == {pairs[number].name for number in numbers}


@pytest.mark.slow
def test_pixels_that_were_stored_as_their_tag_says_are_no_fault(dive) -> None:
    root = dive({"right": {2: 3, 3: 3}}, upright=True)
    images = RunConfig().input
    pairs = pairs_of(root / "left", root / "right", images).pairs
    rig = load_rig(root / "cam.yaml")
    found = find_change(Rectification.from_rig(rig), pairs, images)
    assert (found.line, found.odd) == ("", frozenset())


@pytest.mark.slow
@pytest.mark.parametrize("by_tag", [True, False])
def test_check_names_turned_frames_and_ends_with_code_3(by_tag: bool, dive, cli) -> None:
    root = dive({"right": {2: 3}} if by_tag else {})
    if not by_tag:  # by a quarter, in the pixels
        path = root / "right" / "2.jpg"
        Image.open(path).transpose(Image.Transpose.ROTATE_90).save(path)
    words = ["--left", root / "left", "--right", root / "right", "--calib", root / "cam.yaml"]
    code, printed, _ = cli("check", *words)
    named = "EXIF Orientation is 3" if by_tag else "2: the right image is 224x288 px"
    assert code == 3
    assert named in " ".join(printed.split())
