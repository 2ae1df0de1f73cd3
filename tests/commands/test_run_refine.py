"""``run --refine``: a rig that has moved is brought in order from the dive's own pairs, once; one
that has not is left alone.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Cli, Dive, contents

from calibration.formats import native
from stereo_seecolor.run_folder.finished_run import open_run

PITCH_DEG = 0.6
"""1.6 px at the focal length of the small dive."""


def turn_right_camera(dive: Dive) -> None:
    """Write a calibration whose right camera was turned since."""
    rig = native.read(dive.root / "cam.yaml")
    turn = np.eye(4)
    turn[:3, :3] = cv2.Rodrigues(np.radians([PITCH_DEG, 0.0, 0.0]))[0]
    native.write(replace(rig, T_right_left=turn @ rig.T_right_left), dive.root / "cam.yaml")


@pytest.mark.slow
def test_a_moved_rig_is_refined_once(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(4), tmp_path / "out"
    turn_right_camera(dive)
    code, printed, _ = cli(*dive.command(out, "--refine"))
    assert code == 0
    assert "note: calibration: refined, as rig.yaml records" in printed
    assert "camera has moved since" not in printed
    refined = native.read(out / "rig.yaml")
    assert (
        refined.refinement and refined.refinement.after_px < 0.2 < 1 < refined.refinement.before_px
    )
    pitch = refined.refinement.movements[0]
    assert pitch.name == "pitch"
    assert np.degrees(pitch.value) == pytest.approx(
        -PITCH_DEG, abs=max(0.02, np.degrees(4 * pitch.std))
    )
    assert "not visible in vertical disparity" in (out / "rig.yaml").read_text()
    assert open_run(out).rig.refinement == refined.refinement
    assert open_run(out).config.input.refine

    before, kept = contents(out), (out / ".state" / "refined_rig.kept").stat().st_mtime_ns
    code, printed, _ = cli(*dive.command(out, "--refine"))
    assert code == 0 and "4 of them kept" in printed and "calibration: refined" in printed
    assert contents(out) == before
    assert (out / ".state" / "refined_rig.kept").stat().st_mtime_ns == kept

    shutil.copy(dive.root / "L" / "0000.png", dive.root / "L" / "0004.png")
    shutil.copy(dive.root / "R" / "0001.png", dive.root / "R" / "0004.png")
    cli(*dive.command(out, "--refine"))
    assert (out / ".state" / "refined_rig.kept").stat().st_mtime_ns != kept, (
        "more pairs than it rests on"
    )


@pytest.mark.slow
def test_the_refined_rig_is_used_again_in_another_run(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out, again = make_dive(3), tmp_path / "out", tmp_path / "again"
    turn_right_camera(dive)
    assert cli(*dive.command(out, "--refine"))[0] == 0
    shutil.copy(out / "rig.yaml", dive.root / "cam.yaml")
    code, printed, _ = cli(*dive.command(again))
    assert code == 0 and "camera has moved since" not in printed
    assert contents(again) == contents(out)


@pytest.mark.slow
def test_a_rig_that_fits_moves_within_its_errors(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive = make_dive(3)
    code, printed, _ = cli(*dive.command(tmp_path / "out", "--refine"))
    assert code == 0 and "calibration: refined, as rig.yaml records" in printed
    found = native.read(tmp_path / "out" / "rig.yaml").refinement
    assert found
    for movement in found.movements:
        assert abs(movement.value) < 3 * movement.std
    assert open_run(tmp_path / "out").geometry.slope_std == found.slope_std


@pytest.mark.slow
def test_a_dive_too_short_to_refine_is_run_all_the_same(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive = make_dive(2)
    turn_right_camera(dive)
    code, printed, _ = cli(*dive.command(tmp_path / "out", "--refine"))
    assert code == 3  # rows that are off by so much make ranges wrong
    assert (
        "calibration: used unchanged, because it could not be refined: 2 of 2 pairs show" in printed
    )
    assert "stereo-seecolor run --refine" in printed


@pytest.mark.slow
@pytest.mark.parametrize("command", ["range", "rectify"])
def test_other_commands_refine_too(
    cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path, command: str
) -> None:
    dive = make_dive(3)
    turn_right_camera(dive)
    code, printed, _ = cli(*dive.command(tmp_path / "out", "--refine", command=command))
    assert code == 0 and "calibration: refined" in printed


@pytest.mark.slow
def test_overwrite_refines_again(cli: Cli, make_dive: Callable[..., Dive], tmp_path: Path) -> None:
    dive, out = make_dive(3), tmp_path / "out"
    turn_right_camera(dive)
    cli(*dive.command(out, "--refine"))
    kept = (out / ".state" / "refined_rig.kept").stat().st_mtime_ns
    assert cli(*dive.command(out, "--refine", "--overwrite"))[0] == 0
    assert (out / ".state" / "refined_rig.kept").stat().st_mtime_ns != kept
