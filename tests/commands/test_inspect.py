"""``inspect``: what it finds out about a dive, and that the command it prints works."""

import json
import shlex
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import REEF
from small_dives import write_short_reef
from test_inputs_video import smooth_frames, write_video
from test_neighbors import renumber

from calibration import CalibrationError
from calibration.formats import load_rig, write_rig
from calibration.resizing import resized_rig
from stereo_seecolor.cli import main
from stereo_seecolor.cli.look_commands import inspection_text
from stereo_seecolor.commands.inspect import inspect
from stereo_seecolor.commands.inspect_rig import find_calibration, refused_calibrations
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.sides import find_sides
from stereo_seecolor.records import StereoFrame


@pytest.fixture
def cli(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    def call(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["stereo-seecolor", *words])
        with pytest.raises(SystemExit) as end:
            main()
        return int(end.value.code or 0), capsys.readouterr().out

    return call


@pytest.mark.slow
def test_a_dive_is_found_out(make_dive, monkeypatch: pytest.MonkeyPatch) -> None:
    dive, read, times = make_dive(4), FrameReader.read, Counter[str]()

    def counted(reader: FrameReader, pair: Pair) -> StereoFrame:
        times[pair.name] += 1
        return read(reader, pair)

    monkeypatch.setattr(FrameReader, "read", counted)
    found = inspect([dive.root])
    assert set(times.values()) == {2}  # for all tests, and again to be timed
    assert (found.sides.left, found.sides.right) == (dive.root / "L", dive.root / "R")
    assert (found.pairs, found.unpaired, found.misfits) == (4, 0, ())
    (response,) = found.problems  # pictures so small show too little noise
    assert response.startswith("response: not measurable, read as sRGB")
    assert found.calibration is not None
    assert (found.calibration.format, found.calibration.vertical) == ("native", False)
    assert found.calibration.rows is not None
    assert found.calibration.rows.row_error_px < 0.25
    assert found.measured is not None
    assert found.measured.median_range_m == pytest.approx(np.median(dive.range_m), rel=0.1)
    assert found.measured.ground_resolution_m == pytest.approx(
        found.measured.median_range_m / 150, rel=0.05
    )
    assert not found.measured.strobes


@pytest.mark.slow
def test_what_images_cannot_show_is_named_where_the_calibration_does_not_state_it(
    make_dive, cli
) -> None:
    dive = make_dive(2)
    _, printed = cli("inspect", str(dive.root))
    assert "docs/what-it-cannot-know.md" in printed
    calib = next(dive.root.rglob("*.yaml"))
    stated = "errors:\n  focal: 0.001\n  baseline: 0.002\n  stated_by: a board\n"
    calib.write_text(calib.read_text(encoding="utf-8") + stated, encoding="utf-8")
    _, printed = cli("inspect", str(dive.root))
    assert "what-it-cannot-know" not in printed


@pytest.mark.slow
def test_images_that_are_damaged_or_of_another_size_are_named_and_the_others_tested(
    make_dive,
) -> None:
    dive = make_dive(4)
    (dive.root / "L" / "0000.png").write_bytes(b"damaged")
    turned = dive.root / "R" / "0002.png"
    cv2.imwrite(str(turned), cv2.rotate(cv2.imread(str(turned)), cv2.ROTATE_90_CLOCKWISE))
    found = inspect([dive.root])
    assert found.calibration is not None
    assert found.calibration.rows is not None
    _, damaged, other = found.problems
    assert "L/0000.png" in damaged
    assert (
        f"{turned}: is 128x176 px, and most images are 176x128 px: rotated by 90 degrees" in other
    )


@pytest.mark.slow
def test_the_printed_command_works_and_inspect_writes_nothing(
    make_dive, cli, tmp_path, monkeypatch
) -> None:
    dive = make_dive(2)
    before = sorted(tmp_path.rglob("*"))
    code, printed = cli("inspect", str(dive.root))
    assert (code, " GB, without a map (--fuse)\n" in printed) == (0, True)
    assert sorted(tmp_path.rglob("*")) == before
    monkeypatch.chdir(tmp_path)
    code, _ = cli(*shlex.split(printed.splitlines()[-1])[1:])
    assert code == 0
    assert (tmp_path / "out" / "corrected" / "0000.png").exists()


@pytest.mark.slow
def test_sides_that_share_a_folder_and_run_by_pattern(
    make_dive, cli, tmp_path, monkeypatch
) -> None:
    dive, both = make_dive(2), tmp_path / "both"
    both.mkdir()
    for side in ("L", "R"):
        for path in (dive.root / side).iterdir():
            path.rename(both / f"{path.stem}_{side}{path.suffix}")
        (dive.root / side).rmdir()
    code, printed = cli("inspect", str(both), str(dive.root / "cam.yaml"))
    command = shlex.split(printed.splitlines()[-1])
    assert (code, command[3], command[5]) == (0, str(both / "*_L.png"), str(both / "*_R.png"))
    monkeypatch.chdir(tmp_path)
    assert cli(*command[1:])[0] == 0
    assert (tmp_path / "out" / "corrected" / "0000.png").exists()
    assert cli(*command[1:-1], str(both), "--overwrite")[0] == 1, (
        "the folder of the images taken for OUT"
    )
    assert len(list(both.iterdir())) == 4


def test_sides_that_are_links_to_folders_are_found(make_dive, tmp_path: Path) -> None:
    dive, linked = make_dive(1), tmp_path / "linked"
    linked.mkdir()
    for name, side in (("left", "L"), ("right", "R")):
        (linked / name).symlink_to(dive.root / side)
    sides = find_sides([linked])
    assert (sides.left, sides.right) == (linked / "left", linked / "right")


def test_range_maps_are_not_taken_for_a_side(tmp_path: Path) -> None:
    for folder, pixels in (
        ("rgb", np.zeros((4, 6, 3), np.uint8)),
        ("range", np.ones((4, 6), np.float32)),
    ):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "1.tiff"), pixels)
    with pytest.raises(
        InputError,
        match=r"range: holds floating-point numbers.*correct --images .*rgb --range .*range",
    ):
        inspect([tmp_path])


@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_range_maps_alone_are_named(kind: type, tmp_path: Path) -> None:
    (tmp_path / "1.tiff").write_bytes(encode_tiff(np.full((4, 6), 2.5, kind)))
    with pytest.raises(InputError, match=r"no images: if these .*correct --images IMAGES --range"):
        inspect([tmp_path])


def test_range_maps_with_unknown_pixels_are_named_too(tmp_path: Path) -> None:
    for folder in ("left", "range"):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "1.tiff"), np.full((4, 6), np.nan, np.float32))
    with pytest.raises(InputError, match="contain floating-point numbers"):
        inspect([tmp_path])


@pytest.mark.slow
def test_single_images_and_patterns_stand_for_their_folders(make_dive, cli) -> None:
    dive = make_dive(2)
    images = [str(path) for side in ("L", "R") for path in sorted((dive.root / side).iterdir())]
    for given in (images, [str(dive.root / "L/*.png"), str(dive.root / "R/*.png")]):
        code, printed = cli("inspect", *given, str(dive.root / "cam.yaml"))
        assert (code, f"left:  {dive.root / 'L'}" in printed, "2 pairs" in printed) == (
            0,
            True,
            True,
        )


def test_bags_are_named_with_the_command_that_shows_them(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    for name in ("dive.mcap", "dive.mcap.zstd", "dive.bag"):
        bag = tmp_path / "day" / name
        bag.write_bytes(b"x")
        for place in (tmp_path, bag):
            with pytest.raises(
                InputError,
                match=rf"{name} is a ROS bag: see what it holds with stereo-seecolor bag-info",
            ) as error:
                inspect([place])
            assert not str(error.value).startswith(":")
        bag.unlink()


def test_float_images_on_both_sides_are_not_called_range_maps(tmp_path: Path) -> None:
    for folder in ("left", "right"):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "1.tiff"), np.ones((4, 6, 3), np.float32))
    with pytest.raises(
        InputError,
        match=r"left and .*right: contain floating-point numbers.*save them as 16-bit PNG",
    ):
        inspect([tmp_path])


@pytest.mark.slow
def test_numbers_that_are_off_by_one_are_named(make_dive, cli) -> None:
    dive = make_dive(5)
    renumber(dive.root / "L", 0)
    renumber(dive.root / "R", 1)
    code, printed = cli("inspect", str(dive.root))
    assert code == 3
    assert (
        "not a pair: 0022: its images do not show the same scene; the left image of 0022 fits the "
        "right one of 0023" in printed
    )
    assert "a camera has moved" not in printed
    assert "--refine" not in printed


@pytest.mark.slow
def test_folders_that_show_different_scenes_are_no_sides(tmp_path: Path) -> None:
    reef = tmp_path / "reef"
    write_short_reef(reef, range(0, 4))
    for k, name in enumerate(sorted(path.name for path in (reef / "left").iterdir())[::3]):
        (tmp_path / f"dive/scene{k}").mkdir(parents=True)
        for i, side in enumerate(("left", "right")):
            shutil.copy(reef / side / name, tmp_path / f"dive/scene{k}/im{i}.png")
    shutil.copy(reef / "cam.yaml", tmp_path / "dive")
    found = inspect([tmp_path / "dive"])
    assert any(
        "too little in common to be the two sides: name them yourself" in line
        for line in found.problems
    )
    assert shlex.split(found.run_command)[3:6:2] == ["LEFT", "RIGHT"]


@pytest.mark.slow
def test_a_pair_of_open_water_is_no_misfit(make_dive) -> None:
    dive = make_dive(3)
    for seed, side in enumerate("LR"):
        image = sorted((dive.root / side).iterdir())[1]
        water = np.random.default_rng(seed).normal(90, 2, cv2.imread(str(image)).shape)
        cv2.imwrite(str(image), np.clip(water, 0, 255).astype(np.uint8))
    assert inspect([dive.root]).misfits == ()


@pytest.mark.slow
def test_swapped_sides_are_exchanged_in_the_run_line(make_dive) -> None:
    dive = make_dive(1)
    for old, new in (("L", "x"), ("R", "L"), ("x", "R")):
        (dive.root / old).rename(dive.root / new)
    found = inspect([dive.root])
    assert "the run line exchanges the sides" in found.problems
    assert f"--left {dive.root / 'R'} --right {dive.root / 'L'}" in found.run_command


def test_a_calibration_that_is_refused_is_named(make_dive) -> None:
    dive = make_dive(1)
    text = (dive.root / "cam.yaml").read_text()
    (dive.root / "cam.yaml").write_text(text.replace("medium:", "medium: ice #"))
    assert any(
        "cam.yaml" in problem and "ice" in problem for problem in inspect([dive.root]).problems
    )


def test_a_calibration_of_another_size_is_refused_with_what_to_do(make_dive) -> None:
    dive = make_dive(1)
    cam = dive.root / "cam.yaml"
    rig = load_rig(cam)
    write_rig(resized_rig(rig, (2 * rig.left.image_size[0], 2 * rig.left.image_size[1])), cam)
    with pytest.raises(
        CalibrationError, match=rf"0.5 times the size: .*convert-calib {cam} resized.yaml --resize"
    ):
        inspect([dive.root])
    sides = [write_video(dive.root / f"{side}.avi", smooth_frames(2)) for side in ("left", "right")]
    with pytest.raises(CalibrationError, match=r"the left image is .* but the calibration is for"):
        inspect([*sides, cam])


@pytest.mark.slow
def test_disk_space_is_what_a_run_takes(make_dive, cli, tmp_path) -> None:
    dive = make_dive(3)
    found = inspect([dive.root])
    assert found.measured is not None
    cli(*dive.command(tmp_path / "out"))
    taken = sum(path.stat().st_size for path in (tmp_path / "out").rglob("*") if path.is_file())
    assert found.measured.disk_bytes == pytest.approx(taken, rel=0.15)


def test_without_a_calibration_it_says_what_to_do(make_dive, cli) -> None:
    dive = make_dive(1)
    (dive.root / "cam.yaml").unlink()
    code, printed = cli("inspect", str(dive.root), "--json")
    found = json.loads(printed)
    assert code == 0
    assert found["calibration"] is None
    assert any("no calibration was found" in problem for problem in found["problems"])
    assert "--calib CALIBRATION" in found["run_command"]


@pytest.mark.slow
def test_several_calibrations_and_lonely_files_are_named(make_dive) -> None:
    dive = make_dive(1)
    (dive.root / "old.yaml").write_bytes((dive.root / "cam.yaml").read_bytes())
    (dive.root / "L" / "9999.png").write_bytes((dive.root / "L" / "0000.png").read_bytes())
    problems = inspect([dive.root]).problems
    assert "1 file without a partner, the first: 9999.png (no right image matches)" in problems
    assert "2 calibrations were found, the first was used: cam.yaml, old.yaml" in problems


def test_a_calibration_given_by_name_comes_before_those_in_a_folder(make_dive, tmp_path) -> None:
    root = make_dive(1).root
    given = tmp_path / "zz.yaml"
    given.write_bytes((root / "cam.yaml").read_bytes())
    size = load_rig(given).left.image_size
    assert [one.path for one in find_calibration([root, given], size)] == [given, root / "cam.yaml"]


@pytest.mark.slow
def test_unshifted_bits_are_used_in_full(make_dive) -> None:
    dive = make_dive(1, dtype=np.uint16)
    for path in (dive.root / "L" / "0000.png", dive.root / "R" / "0000.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) // 64)
    found = inspect([dive.root])
    assert (found.left.bits, found.left.used_bits) == (16, 10)
    assert found.measured and found.measured.coverage > 0.5


def test_videos_are_named_and_not_unpacked(tmp_path: Path) -> None:
    video = write_video(tmp_path / "both.avi", smooth_frames(2))
    found = inspect([tmp_path])
    assert found.sides.left == found.sides.right == video
    assert f"--left {video} --right {video}" in found.run_command
    assert (found.left.frames, found.left.size) == (2, smooth_frames(2)[0].shape[1::-1])
    assert f"px, {found.left.rate_hz:.6g} Hz, 2 frames" in inspection_text(found)
    assert any("if it shows only one camera" in problem for problem in found.problems)
    wide = write_video(tmp_path / "wide.avi", [np.hstack([one, one]) for one in smooth_frames(2)])
    assert not any("side by side" in problem for problem in inspect([wide]).problems)
    write_video(tmp_path / "left.avi", smooth_frames(2))
    write_video(tmp_path / "right.avi", smooth_frames(2))
    two = inspect([tmp_path / "left.avi", tmp_path / "right.avi"])
    assert "stereo-seecolor sync" in " ".join(two.problems)


def test_a_place_that_is_missing_is_named(make_dive, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cam2\.yaml: does not exist"):
        inspect([make_dive(1).root, tmp_path / "cam2.yaml"])


@pytest.mark.slow
def test_trajectories_are_named(make_dive, cli) -> None:
    dive = make_dive(3)
    (dive.root / "nav.csv").write_text(
        "name,lat,lon,depth,heading\n0000.png,1,2,3,4\n0002.png,1,2,3,4\n0009.png,1,2,3,4\n"
    )
    (dive.root / "a.tum").write_text("0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n")  # frames have no time
    (dive.root / "notes.txt").write_text("visibility 5 m\n")
    (dive.root / "usbl.csv").write_text("time,lat,lon,depth\n1,1,2,3\n2,1,2,3\n")
    found = inspect([dive.root])
    assert [
        problem
        for problem in found.problems
        if "usbl.csv" in problem
        and "is a table without heading (it has time, lat, lon, depth)" in problem
    ]
    assert [(one.path.name, one.format, one.poses, one.pairs, one.by) for one in found.poses] == [
        ("a.tum", "TUM", 2, 0, "time"),
        ("nav.csv", "table of navigation", 3, 2, "name"),
    ]
    _, printed = cli("inspect", str(dive.root))
    assert "nav.csv (table of navigation): 3 poses, for 2 of 3 pairs by name" in printed


@pytest.mark.slow
def test_trajectories_are_compared_with_the_pairs_as_a_map_does(tmp_path: Path, cli) -> None:
    """By image numbers, too; a clock that is a year off is named, and no map with it proposed."""
    track = np.loadtxt(REEF / "trajectory.tum")
    for name, times_s in {"number": np.arange(12), "year": track[:, 0] + 3.15e7}.items():
        np.savetxt(tmp_path / f"{name}.tum", np.column_stack([times_s, track[:, 1:]]))
    _, printed = cli("inspect", *(str(REEF / side) for side in ("left", "right")), str(tmp_path))
    lines = {
        name: [line for line in printed.splitlines() if f"{name}.tum" in line]
        for name in ("number", "year")
    }
    read, note = lines["number"]
    assert "12 poses, for 12 of 12 pairs by time; for a map" in read
    assert "read as image numbers" in note
    read, note = lines["year"]
    assert read.endswith("12 poses, for 0 of 12 pairs by time")
    assert "it begins 364.583 days after the first frame" in note


def test_an_archive_beside_the_images_is_named_where_no_calibration_is(tmp_path: Path) -> None:
    (tmp_path / "c.zip").write_bytes(b"PK\x03\x04")
    assert refused_calibrations([tmp_path], (640, 480)) == (
        f"{tmp_path / 'c.zip'}: is an archive: unpack it, if it holds the calibration",
    )
