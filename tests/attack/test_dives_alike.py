"""Two dives that look alike at first: neither takes the other's OUT without being asked; a dive
that grew or moved goes on.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import CopyRun, Dive, contents

from stereo_seecolor.commands.run import correct, range_maps, run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import OutputError

ANOTHER = "contains the results of another dive"
ONE_WATER = "color.lock=survey"
"""Fitted in half the time of the default's segments, which make no other dive."""


@pytest.fixture
def dive(make_dive: Callable[..., Dive], tmp_path: Path) -> Dive:
    made = make_dive(4)
    made.root.rename(tmp_path / "monday")
    return replace(made, root=tmp_path / "monday")


def go(dive: Dive, out: Path, command: Callable[..., object] = run, **options: object) -> object:
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    return command(*sides, out, load_config(None, [ONE_WATER]), replace(RunOptions(), **options))


def copied(dive: Dive, name: str) -> Dive:
    shutil.copytree(dive.root, dive.root.parent / name)
    return replace(dive, root=dive.root.parent / name)


def exchange(dive: Dive, first: str, second: str) -> None:
    """Another dive with frames of the same names."""
    for side in "LR":
        one, two = dive.root / side / f"{first}.png", dive.root / side / f"{second}.png"
        held = one.read_bytes()
        one.write_bytes(two.read_bytes())
        two.write_bytes(held)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "frames"), [(run, ("0001", "0002")), (range_maps, ("0002", "0003"))]
)
def test_dives_that_begin_with_the_same_frame_are_two(
    copy_run: CopyRun,
    dive: Dive,
    tmp_path: Path,
    command: Callable[..., object],
    frames: tuple[str, str],
) -> None:
    out, other = tmp_path / "out", copied(dive, "tuesday")
    exchange(other, *frames)
    copy_run(out, 4, ONE_WATER)
    before = contents(out)
    with pytest.raises(OutputError, match=ANOTHER):
        go(other, out, command)
    assert contents(out) == before
    assert go(other, out, command, overwrite=True).all_done


@pytest.mark.slow
def test_another_dive_at_the_same_path_is_another(dive: Dive, tmp_path: Path) -> None:
    """A memory card that is used again has the same path and the same names."""
    out = tmp_path / "out"
    go(dive, out)
    before = contents(out)
    exchange(dive, "0000", "0001")
    exchange(dive, "0002", "0003")
    with pytest.raises(OutputError, match=ANOTHER):
        go(dive, out)
    assert contents(out) == before


@pytest.mark.slow
def test_a_dive_with_other_names_and_the_same_first_frame_is_another(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out, other = tmp_path / "out", copied(dive, "tuesday")
    for side in "LR":
        for name in ("0001", "0002", "0003"):
            (other.root / side / f"{name}.png").rename(other.root / side / f"1{name}.png")
    copy_run(out, 4, ONE_WATER)
    with pytest.raises(OutputError, match=ANOTHER):
        go(other, out)


@pytest.mark.slow
def test_a_correction_of_another_dives_images_is_refused(copy_run: CopyRun, tmp_path: Path) -> None:
    copy_run(tmp_path / "ranges", 4, ONE_WATER)
    for place in ("a", "b"):
        shutil.copytree(tmp_path / "ranges/corrected", tmp_path / place / "images")
        shutil.copytree(tmp_path / "ranges/range", tmp_path / place / "range")
    images = tmp_path / "b/images"
    (images / "0002.png").write_bytes((images / "0003.png").read_bytes())
    correct(tmp_path / "a/images", tmp_path / "a/range", tmp_path / "out")
    with pytest.raises(OutputError, match=ANOTHER):
        correct(images, tmp_path / "b/range", tmp_path / "out")


@pytest.mark.slow
@pytest.mark.parametrize("change", ["grew", "grew before", "lost the first", "lost the last"])
def test_a_dive_that_moved_and_changed_goes_on(dive: Dive, tmp_path: Path, change: str) -> None:
    out, moved = tmp_path / "out", copied(dive, "moved")
    for side in "LR":
        if change == "grew":
            (dive.root / side / "0003.png").unlink()
        elif change == "grew before":
            (dive.root / side / "0000.png").unlink()
        elif change.startswith("lost"):
            (moved.root / side / ("0000.png" if "first" in change else "0003.png")).unlink()
    go(dive, out)
    summary = go(moved, out)
    assert summary.all_done and len(list((out / "range").iterdir())) == (
        3 if "lost" in change else 4
    )


@pytest.mark.slow
def test_a_stopped_run_of_a_dive_that_moved_goes_on(dive: Dive, tmp_path: Path) -> None:
    from conftest import AtPair

    out = tmp_path / "out"
    go(dive, out, workers=1, listener=AtPair(2, KeyboardInterrupt))
    assert go(copied(dive, "moved"), out).all_done
