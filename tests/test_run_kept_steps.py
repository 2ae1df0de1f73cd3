"""Relative poses of neighbors that a run keeps for the first look at its map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from conftest import REEF, SampleRun
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.extras.evaluation.maps import trajectory_error
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.mapping.track.known_steps import STEP, placed_by
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.kept_steps import KeptSteps, frame_mark
from stereo_seecolor.run_folder.layout import steps_file
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

GEOMETRY = RectifiedPair(500.0, 320.0, 320.0, 256.0, 0.1, (640, 512))
MARKS = [frame_mark(f"{k}", "ab") for k in range(4)]


def steps() -> NDArray[np.void]:
    """Half a meter along x from each frame to the next, and a weak one that contradicts them."""
    T, false = np.eye(4), np.eye(4)
    T[0, 3], false[0, 3] = 0.5, 7.0
    return np.array([(k, k + 1, T, 100) for k in range(3)] + [(0, 2, false, 30)], STEP)


def test_steps_place_frames_one_after_the_other() -> None:
    placement = placed_by(steps(), 5)
    assert placement is not None
    np.testing.assert_allclose(placement.T_world_camera[:4, 0, 3], [0, 0.5, 1.0, 1.5], atol=1e-6)
    assert placement.components.tolist() == [0, 0, 0, 0, -1]
    assert placed_by(steps()[:0], 5) is None


def test_kept_steps_are_found_again_by_name_and_image(tmp_path: Path) -> None:
    steps_file(tmp_path).parent.mkdir()
    KeptSteps.of(GEOMETRY, MARKS, steps()).save(tmp_path)
    kept = KeptSteps.load(tmp_path)
    assert kept is not None
    np.testing.assert_array_equal(kept.among(GEOMETRY, MARKS), steps())
    changed = [frame_mark("new", "ab"), MARKS[0], MARKS[1], frame_mark("2", "cd"), MARKS[3]]
    found = kept.among(GEOMETRY, changed)
    assert found[["i", "j"]].tolist() == [(1, 2)]
    assert not len(kept.among(replace(GEOMETRY, focal_px=501.0), MARKS))


def test_damaged_steps_are_not_there(tmp_path: Path) -> None:
    steps_file(tmp_path).parent.mkdir()
    assert KeptSteps.load(tmp_path) is None
    steps_file(tmp_path).write_bytes(b"PK\x03\x04 cut")
    assert KeptSteps.load(tmp_path) is None


def test_a_run_keeps_how_its_frames_lie_to_each_other(sample_run: SampleRun) -> None:
    """README's first run, against the poses that its images were drawn from."""
    kept, run = KeptSteps.load(sample_run.out), open_run(sample_run.out)
    assert kept is not None
    geometry = SurveyFrames(run).geometry
    steps = kept.among(geometry, [frame_mark(frame.name, frame.sha256) for frame in run.frames])
    placement = placed_by(steps, len(run.frames))
    assert placement is not None and (placement.components == 0).all()
    found_m, true_m = placement.T_world_camera[:, :3, 3], read_trajectory(REEF / "trajectory.tum").T_world_camera[:, :3, 3]
    assert trajectory_error(found_m, true_m).fraction < 0.01
