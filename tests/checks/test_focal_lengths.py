"""A focal length that EXIF says changes is named from its first pair on."""

from pathlib import Path

import pytest
from calibration_binaries import small_rig
from PIL import ExifTags, Image
from small_dives import write_short_reef

from stereo_seecolor.checks.focal_lengths import changed_focal_lengths, stated_of_sides
from stereo_seecolor.checks.rig import check_processed
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.checks.verdict import RANGES, DiveVerdict
from stereo_seecolor.commands.check import check
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.dive_pairs import pair_sides
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.pipeline import Pipeline

PAIRS = 9


def verdict(folder: Path, left_mm: list[float | None], right_mm: list[float | None]) -> DiveVerdict:
    return changed_focal_lengths(DiveImages(pairs_of(folder, left_mm, right_mm), RunConfig()))


def pairs_of(folder: Path, left_mm: list[float | None], right_mm: list[float | None]) -> list[Pair]:
    pairs = []
    for number, sides in enumerate(zip(left_mm, right_mm, strict=True)):
        paths = [folder / f"{side}{number}.jpg" for side in "LR"]
        for path, focal_mm in zip(paths, sides, strict=True):
            exif = Image.Exif()
            if focal_mm:
                exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLength] = focal_mm
            Image.new("RGB", (8, 8)).save(path, exif=exif)
        pairs.append(Pair(f"p{number}", *paths))
    return pairs


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


@pytest.mark.parametrize(("right_mm", "is_named"), [(24.0, True), (18.0, False), (None, False)])
def test_sides_whose_ratio_is_not_the_calibrations_are_named(
    right_mm: float | None, is_named: bool, tmp_path: Path
) -> None:
    pairs = pairs_of(tmp_path, [18.0], [right_mm])
    note = stated_of_sides(pairs, small_rig())
    assert ("18 mm (left) and 24 mm (right), 0.75 to 1" in note) is is_named


@pytest.mark.slow
@pytest.mark.parametrize("zoom", [1.0, 1.04])
def test_a_ratio_is_named_where_the_images_contradict_the_calibration(
    zoom: float, tmp_path: Path
) -> None:
    write_short_reef(tmp_path, range(2))
    for side in ("left", "right"):
        for path in (tmp_path / side).iterdir():
            image, exif = Image.open(path).convert("RGB"), Image.Exif()
            if side == "right":
                x, y = ((1 - 1 / zoom) * size / 2 for size in image.size)
                bicubic = Image.Resampling.BICUBIC
                matrix = (1 / zoom, 0, x, 0, 1 / zoom, y)
                image = image.transform(image.size, Image.Transform.AFFINE, matrix, bicubic)
                exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLength] = 19.0
            else:
                exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLength] = 18.0
            image.save(path.with_suffix(".jpg"), quality=95, exif=exif)
            path.unlink()
    rig = tmp_path / "cam.yaml"
    of_check = check(tmp_path / "left", tmp_path / "right", str(rig)).images.notes
    pipeline = Pipeline(rig)
    pairs = pair_sides(tmp_path / "left", tmp_path / "right", pipeline.config.input).pairs
    of_run = check_processed(pipeline, pairs).notes
    for notes in (of_check, of_run):
        assert any("18 mm (left) and 19 mm (right)" in note for note in notes) is (zoom > 1)


@pytest.mark.parametrize("left_mm", [[18.0] * PAIRS, [None] * PAIRS, [18.0, 18.1, None] * 3])
def test_no_change_is_no_note(left_mm: list[float | None], tmp_path: Path) -> None:
    assert verdict(tmp_path, left_mm, [50.0] * PAIRS) == DiveVerdict()
