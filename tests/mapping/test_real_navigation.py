"""Navigation held against the pictures on a real reef dive: its survey's own poses fit, disturbed
ones are averaged out or named.

The dive's first pairs in half their size; the poses are of the survey's own SLAM of these
pictures.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from conftest import SampleRun
from test_mapping_navigation import Poses, noisy, north_east_down, positions, w_first

from calibration.transforms import inverse, rotation_from_vector
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.inputs.trajectories import rectified_trajectory
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.mapping.navigation.comparison import Navigation, examine
from stereo_seecolor.mapping.placing import place_survey
from stereo_seecolor.mapping.survey import Survey
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.mapping.track import odometry
from stereo_seecolor.records import Trajectory
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

pytestmark = [pytest.mark.real_data, pytest.mark.slow]
PAIRS = 8
CONFIG = MappingConfig(voxel_m=0.04, metrics_m=0.5)


@dataclass(frozen=True)
class RealDive:
    """A survey, its track, and where its rectified left camera stood by the published poses, with a
    name for each frame.
    """

    survey: Survey
    track: odometry.Track
    trajectory: Trajectory

    def judged(self, trajectory: Trajectory) -> Navigation:
        """What is said of poses; the track is followed once."""
        given = place(self.survey.index, trajectory)
        return examine(given, self.survey, self.track.edges, trajectory, CONFIG).navigation


@pytest.fixture(scope="module")
def dive(real_data: Path, real_dive: SampleRun) -> RealDive:
    finished = open_run(real_dive.out)
    frames = SurveyFrames(finished, frames=finished.frames[:PAIRS])
    survey = Survey(frames, frames.geometry, FrameIndex.build(frames, frames.geometry))
    read = rectified_trajectory(
        real_data / "acfr/poses_left_raw.tum",
        MappingConfig(poses_of="raw"),
        frames.T_rectified_left,
    )
    chosen = [
        int(np.abs(read.timestamps_s - time_s).argmin()) for time_s in survey.index.timestamps_s
    ]
    published = Trajectory(
        tuple(survey.index.names), read.timestamps_s[chosen], read.T_world_camera[chosen]
    )
    return RealDive(survey, odometry.follow(survey), published)


def test_the_published_poses_fit(dive: RealDive) -> None:
    found = dive.judged(dive.trajectory)
    assert found.fits and not found.advice
    assert found.position_residual_m < 0.01 and found.attitude_residual_deg < 0.3
    assert found.depth_residual_m < 1.5 * found.depth_noise_m


WRONG: dict[str, Callable[[Poses], Poses]] = {
    "the quaternion's w first": w_first,
    "x and y swapped": positions(lambda p: p[:, [1, 0, 2]]),
    "x mirrored": positions(lambda p: p * [-1, 1, 1]),
    "y mirrored": positions(lambda p: p * [1, -1, 1]),
    "z pointing down": positions(lambda p: p * [1, 1, -1]),
    "positions north-east-down": positions(lambda p: p[:, [1, 0, 2]] * [1, 1, -1]),
    "world-to-camera poses": inverse,
    "each pose 1 frame(s) earlier": lambda T: np.roll(T, 1, axis=0),
    "each pose 2 frame(s) later": lambda T: np.roll(T, -2, axis=0),
    "the poses in the opposite order": lambda T: T[::-1],
    "positions in feet": positions(lambda p: p / 0.3048),
    "positions in centimeters": positions(lambda p: p * 100),
    "positions rotated by -30 degrees about the vertical, or headings by the opposite angle": positions(  # noqa: E501
        lambda p: p @ rotation_from_vector(np.radians([0, 0, 30])).T
    ),
}


@pytest.mark.parametrize("reading", WRONG)
def test_poses_read_wrongly_are_named(dive: RealDive, reading: str) -> None:
    found = dive.judged(
        replace(
            dive.trajectory, T_world_camera=WRONG[reading](dive.trajectory.T_world_camera.copy())
        )
    )
    assert not found.fits
    assert found.advice == f"the given poses contradict the images; they would fit with {reading}"


@pytest.mark.parametrize(
    ("later_s", "said"), [(0.375, "-0.38 s"), (1.25, "-1.25 s"), (-0.75, "+0.75 s")]
)
def test_a_clock_apart_is_named(dive: RealDive, later_s: float, said: str) -> None:
    true = dive.trajectory
    found = dive.judged(
        replace(true, names=("",) * len(true.names), timestamps_s=true.timestamps_s + later_s)
    )
    assert not found.fits
    assert found.advice.endswith(f"they would fit with {said} added to the times of the poses")


def test_a_scale_and_a_jump_are_named_and_do_not_contradict(dive: RealDive) -> None:
    longer, jumped = dive.trajectory.T_world_camera.copy(), dive.trajectory.T_world_camera.copy()
    longer[:, :3, 3] *= 1.05
    jumped[4:, :3, 3] += [0.5, 0.5, 0.0]
    for T, said in (
        (longer, "the given positions are 1.0"),
        (jumped, "the given positions jump by 0.71 m"),
    ):
        found = dive.judged(replace(dive.trajectory, T_world_camera=T))
        assert found.fits
        assert found.advice.startswith(said)


def test_north_east_down_is_named_and_not_used(
    dive: RealDive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(odometry, "follow", lambda _: dive.track)
    upside_down = replace(
        dive.trajectory, T_world_camera=north_east_down(dive.trajectory.T_world_camera.copy())
    )
    found = place_survey(dive.survey, CONFIG, upside_down).navigation
    assert found and not found.fits and "they would fit as north-east-down" in found.advice


def test_noise_of_navigation_does_not_reach_the_rugosity(dive: RealDive, tmp_path: Path) -> None:
    """2 degrees, 10 cm and 3 cm of depth; against the poses that were disturbed."""
    rugosity = {}
    for seed in (None, 1):
        T = dive.trajectory.T_world_camera.copy()
        given = replace(dive.trajectory, T_world_camera=T if seed is None else noisy(T, seed))
        summary = build_map(
            dive.survey.frames, dive.survey.geometry, tmp_path / str(seed), CONFIG, given
        )
        assert summary.navigation and summary.navigation.fits and not summary.navigation.advice
        with (tmp_path / str(seed) / "reef_metrics.csv").open() as file:
            rugosity[seed] = float(next(csv.DictReader(file))["linear_rugosity"])
    assert rugosity[1] == pytest.approx(rugosity[None], rel=0.02)
