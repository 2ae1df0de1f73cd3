"""A focal length that EXIF says changes is named from its first pair on."""

from pathlib import Path

import pytest
from PIL import ExifTags, Image

from stereo_seecolor.checks.focal_lengths import changed_focal_lengths
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.verdict import RANGES, DiveVerdict
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.pairing import Pair

PAIRS = 9


def verdict(folder: Path, left_mm: list[float | None], right_mm: list[float | None]) -> DiveVerdict:
    pairs = []
    for number, sides in enumerate(zip(left_mm, right_mm, strict=True)):
        paths = [folder / f"{side}{number}.jpg" for side in "LR"]
        for path, focal_mm in zip(paths, sides, strict=True):
            exif = Image.Exif()
            if focal_mm:
                exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLength] = focal_mm
            Image.new("RGB", (8, 8)).save(path, exif=exif)
        pairs.append(Pair(f"p{number}", *paths))
    return changed_focal_lengths(DiveImages(pairs, RunConfig()))


ZOOMED: list[float | None] = [18.0] * 5 + [24.0] * 4


def test_two_lenses_that_zoom_alike_make_ranges_wrong(tmp_path: Path) -> None:
    found = verdict(tmp_path, ZOOMED, ZOOMED)
    (note,) = found.notes
    assert found.wrong == RANGES
    assert note.startswith("input: from p5 on, EXIF of the left and right images states a focal ")
    assert "24 mm, and 18 mm before" in note and "wrong by 33%" in note


def test_rows_judge_what_one_side_alone_states(tmp_path: Path) -> None:
    found = verdict(tmp_path, [18.0] * 3 + [24.0] * 2 + [18.0] * 4, [None] * PAIRS)
    assert [note[:40] for note in found.notes] == ["input: from p3 to p4, EXIF of the left i"]
    assert not found.wrong


@pytest.mark.parametrize("left_mm", [[18.0] * PAIRS, [None] * PAIRS, [18.0, 18.1, None] * 3])
def test_no_change_is_no_note(left_mm: list[float | None], tmp_path: Path) -> None:
    assert verdict(tmp_path, left_mm, [50.0] * PAIRS) == DiveVerdict()
