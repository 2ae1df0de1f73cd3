"""Pairs whose numbers are off: found, and the neighbor that fits named."""

from pathlib import Path

import cv2
import pytest

from calibration import Rectification
from calibration.formats import load_rig
from calibration.verification.matches import describe_left, describe_right
from calibration.verification.same_scene import agreeing_points
from stereo_seecolor.checks.neighbors import misfit_notes, neighbor_that_fits
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import pair_folders

SAMPLES = Path(__file__).parents[2] / "data_samples" / "reef"


def renumber(folder: Path, by: int) -> None:
    for path in list(folder.iterdir()):
        path.rename(folder / f"{int(path.stem) + by + 20:04d}.png")


@pytest.mark.slow
@pytest.mark.parametrize(("by", "fits"), [(0, None), (1, 1), (-1, -1), (2, 2), (3, 3)])
def test_the_neighbor_that_fits_is_named(make_dive, by: int, fits: int | None) -> None:
    dive = make_dive(8)
    renumber(dive.root / "L", 0)
    renumber(dive.root / "R", by)
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    middle = next(pair for pair in pairs if pair.name == "0023")
    found = neighbor_that_fits(middle, pairs, rectification, InputConfig())
    if fits is None:
        assert found is None
    else:
        assert found is not None
        assert int(found.name) == int(middle.name) + fits


@pytest.mark.slow
def test_true_pairs_agree_a_hundred_times_better_than_false_ones() -> None:
    pairs = pair_folders(SAMPLES / "left", SAMPLES / "right", InputConfig()).pairs
    rectification = Rectification.from_rig(load_rig(SAMPLES / "cam.yaml"))
    left = describe_left(rectification, read_image(pairs[0].left))
    true, false = (
        agreeing_points(rectification, left, describe_right(rectification, read_image(pair.right)))
        for pair in pairs[:2]
    )
    assert true > 500
    assert false < 5


def test_a_damaged_neighbor_is_passed_over(make_dive) -> None:
    dive = make_dive(3)
    (dive.root / "R" / "0001.png").write_bytes(b"damaged")
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    assert neighbor_that_fits(pairs[0], pairs, rectification, InputConfig()) is None


@pytest.mark.slow
def test_a_run_names_the_neighbor_that_fits(make_dive, tmp_path: Path) -> None:
    dive = make_dive(4)
    renumber(dive.root / "L", 0)
    renumber(dive.root / "R", 1)
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert summary.count("failed") == 3
    assert (
        "0021.png fits 0022.png, not 0021.png: do both sides have the same numbers?"
        in summary.notes
    )


@pytest.mark.slow
def test_notes_are_given_for_a_few_pairs_and_none_for_files_that_are_gone(make_dive) -> None:
    dive = make_dive(6)
    renumber(dive.root / "L", 0)
    renumber(dive.root / "R", 1)
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    pairs[0].left.unlink()
    notes = misfit_notes(pairs, {pair.name for pair in pairs[:4]}, rectification, InputConfig())
    assert [note.partition(",")[0] for note in notes] == [
        "0022.png fits 0023.png",
        "0023.png fits 0024.png",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("lost", "short"), [("R", "right"), ("L", "left")])
def test_where_a_slip_begins_is_named(make_dive, lost: str, short: str) -> None:
    """One image is lost on one side, and those after it are numbered on."""
    dive = make_dive(9)
    images = sorted((dive.root / lost).iterdir())
    for image, place in zip(images[4:], images[3:], strict=False):
        image.replace(place)
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    failed = {pair.name for pair in pairs[3:]}
    (note,) = misfit_notes(pairs, failed, rectification, InputConfig())
    assert (
        f"from {pairs[3].name} to {pairs[-1].name} (5 pairs that failed) left and right are 1 "
        "image out of synchronization" in note
    )
    assert f"{short} lacks 1 image before {pairs[3].name}" in note


@pytest.mark.slow
def test_parts_that_are_out_of_step_are_named_where_both_sides_lost_images(make_dive) -> None:
    dive = make_dive(14)
    for side, lost in (("L", (2, 8)), ("R", (5, 11))):
        images = sorted((dive.root / side).iterdir())
        kept = [image for number, image in enumerate(images) if number not in lost]
        for image, place in zip(kept, images, strict=False):
            image.replace(place)
        for image in images[len(kept) :]:
            image.unlink(missing_ok=True)
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    failed = {pairs[number].name for number in (2, 3, 4, 7, 8, 9)}
    (note,) = misfit_notes(pairs, failed, rectification, InputConfig())
    assert "out of synchronization in several parts" in note
    assert (
        f"{pairs[2].name} to {pairs[4].name} by +1 ({pairs[3].left.name} fits {pairs[4].right.name}"
        in note
    )
    assert f"{pairs[7].name} to {pairs[9].name} by +1" in note


@pytest.mark.slow
@pytest.mark.parametrize(
    ("side", "how", "flip"),
    [
        ("R", "right images are mirrored left to right", (1, -1)),
        ("R", "right images are rotated by 180 degrees", (-1, -1)),
        ("L", "images of one side are mirrored top to bottom", (-1, 1)),
    ],
)
def test_images_that_are_turned_from_a_pair_on_are_named(
    make_dive, side: str, how: str, flip: tuple[int, int]
) -> None:
    dive = make_dive(5)
    for path in sorted((dive.root / side).iterdir())[3:]:
        cv2.imwrite(str(path), cv2.imread(str(path))[:: flip[0], :: flip[1]])
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    failed = {pair.name for pair in pairs[3:]}
    (note,) = misfit_notes(pairs, failed, rectification, InputConfig())
    assert note.startswith(f"from {pairs[3].name} to {pairs[4].name} (2 pairs that failed)")
    assert how in note


@pytest.mark.parametrize(("side", "name"), [("L", "left"), ("R", "right")])
def test_a_camera_that_stalled_is_named(make_dive, side: str, name: str) -> None:
    dive = make_dive(5)
    images = sorted((dive.root / side).iterdir())
    for path in images[3:]:
        path.write_bytes(images[2].read_bytes())
    pairs = pair_folders(dive.root / "L", dive.root / "R", InputConfig()).pairs
    rectification = Rectification.from_rig(load_rig(dive.root / "cam.yaml"))
    (note,) = misfit_notes(pairs, {pairs[3].name, pairs[4].name}, rectification, InputConfig())
    assert f"the {name} images are all that of {pairs[2].name}: the {name} camera stalled" in note


@pytest.mark.slow
def test_cameras_that_count_on_their_own_are_named(make_dive, tmp_path: Path) -> None:
    """Of a few numbers that coincide, farther apart than neighbors are compared."""
    dive = make_dive(8)
    renumber(dive.root / "L", 0)
    renumber(dive.root / "R", 5)
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert (summary.count("failed"), summary.count("unpaired")) == (3, 10)
    (note,) = (note for note in summary.notes if "counted" in note)
    assert note.startswith("0026.png fits 0031.png, not 0026.png: each camera counted its 8 images")
