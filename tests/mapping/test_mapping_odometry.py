"""Poses from the pictures alone: near the truth, broken rather than wrong."""

import dataclasses

import cv2
import numpy as np
import pytest
from mapping_scene import ReefFrames

from benchmarks.map_errors import trajectory_error
from calibration.transforms import inverse, rotation_from_vector
from stereo_seecolor.errors import DeviceError, MappingError
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track import odometry, pose_graph
from stereo_seecolor.mapping.track.features import detect
from stereo_seecolor.mapping.track.relative_pose import Edge, relative_pose
from stereo_seecolor.records import SurveyFrame

ALONE = 0
"""Rounds of looking for loops: none."""


@pytest.fixture(scope="module")
def reef(flown_reef: ReefFrames) -> ReefFrames:
    return flown_reef


@pytest.fixture(scope="module")
def frames(reef: ReefFrames) -> list[SurveyFrame]:
    return [reef[i] for i in range(len(reef))]


def estimate(
    frames: list[SurveyFrame],
    reef: ReefFrames,
    rounds: int = odometry.SETTINGS.loop_rounds,
) -> Placement:
    return odometry.solve(followed(frames, reef), rounds)


def followed(frames: list[SurveyFrame], reef: ReefFrames) -> odometry.Track:
    return odometry.follow(Survey(frames, reef.pair, FrameIndex.build(frames, reef.pair)))


def blank(frame: SurveyFrame) -> SurveyFrame:
    return dataclasses.replace(frame, color=np.full_like(frame.color, 90))


@pytest.mark.slow
def test_two_frames_give_their_relative_pose(reef: ReefFrames, frames: list[SurveyFrame]) -> None:
    edge = relative_pose(detect(frames[0], reef.pair), detect(frames[1], reef.pair), reef.pair)
    assert edge is not None
    T = reef.trajectory.T_world_camera
    truth = inverse(T[0]) @ T[1]
    assert np.linalg.norm(edge.T_a_b[:3, 3] - truth[:3, 3]) < 0.01
    assert np.sqrt(np.trace(edge.covariance[3:, 3:])) < 0.05


@pytest.mark.slow
def test_the_track_is_found_to_half_a_percent(reef: ReefFrames, frames: list[SurveyFrame]) -> None:
    placement = estimate(frames, reef, ALONE)
    assert placement.components.tolist() == [0] * 12
    error = trajectory_error(
        placement.T_world_camera[:, :3, 3], reef.trajectory.T_world_camera[:, :3, 3]
    )
    assert error.fraction < 0.005


@pytest.mark.slow
def test_frames_out_of_order_are_followed_by_their_times(
    reef: ReefFrames, frames: list[SurveyFrame]
) -> None:
    shuffle = [3, 0, 5, 1, 4, 2]
    placement = estimate([frames[i] for i in shuffle], reef, ALONE)
    assert placement.components.tolist() == [0] * 6
    error = trajectory_error(
        placement.T_world_camera[:, :3, 3], reef.trajectory.T_world_camera[shuffle, :3, 3]
    )
    assert error.fraction < 0.005


@pytest.mark.slow
def test_loops_bring_it_to_a_fifth_of_a_percent(
    reef: ReefFrames, frames: list[SurveyFrame]
) -> None:
    placement = estimate(frames, reef)
    error = trajectory_error(
        placement.T_world_camera[:, :3, 3], reef.trajectory.T_world_camera[:, :3, 3]
    )
    assert error.fraction < 0.002


@pytest.mark.slow
def test_a_frame_that_shows_nothing_is_named_and_the_rest_goes_on(
    reef: ReefFrames, frames: list[SurveyFrame]
) -> None:
    placement = estimate([*frames[:3], blank(frames[3]), *frames[4:]], reef, ALONE)
    assert [u.name for u in placement.unplaced] == [frames[3].name]
    assert placement.components.tolist() == [0, 0, 0, -1] + [0] * 8


@pytest.mark.slow
def test_holes_painted_black_are_no_landmarks(reef: ReefFrames, frames: list[SurveyFrame]) -> None:
    rng = np.random.default_rng(2)
    holed = []
    for frame in frames[:6]:
        hole = (
            cv2.resize(
                (rng.random((13, 16)) < 0.35).astype(np.uint8),
                (256, 208),
                interpolation=cv2.INTER_NEAREST,
            )
            > 0
        )
        color = np.where(hole[..., None], np.uint8(0), frame.color)
        holed.append(
            dataclasses.replace(
                frame, color=color, range_m=np.where(hole, np.float32(np.nan), frame.range_m)
            )
        )
    placement = estimate(holed, reef, ALONE)
    assert placement.components.tolist() == [0] * 6
    error = trajectory_error(
        placement.T_world_camera[:, :3, 3], reef.trajectory.T_world_camera[:6, :3, 3]
    )
    assert error.rms_m < 0.03


@pytest.mark.slow
def test_a_long_blank_segment_breaks_the_map_in_two(
    reef: ReefFrames, frames: list[SurveyFrame]
) -> None:
    blanked = [blank(f) if 5 <= i <= 7 else f for i, f in enumerate(frames)]
    placement = estimate(blanked[:10], reef, ALONE)
    assert placement.components.tolist() == [0, 0, 0, 0, 0, -1, -1, -1, 1, 1]
    warning = placement.warnings[-1]
    assert (
        f"broken into 2 components of 5, 2 frames, first between {frames[4].name} and "
        f"{frames[8].name}" in warning
    )


@pytest.mark.slow
def test_loops_join_what_a_blank_segment_broke(reef: ReefFrames, frames: list[SurveyFrame]) -> None:
    blanked = [blank(f) if 5 <= i <= 7 else f for i, f in enumerate(frames)]
    placement = estimate(blanked, reef)
    placed = placement.components == 0
    assert placed.sum() == 9
    error = trajectory_error(
        placement.T_world_camera[placed, :3, 3], reef.trajectory.T_world_camera[placed, :3, 3]
    )
    assert error.rms_m < 0.05


@pytest.mark.slow
def test_frames_of_another_reef_are_never_joined(
    reef: ReefFrames, frames: list[SurveyFrame]
) -> None:
    other = ReefFrames(SurveySpec(pairs=4, lines=1, image_size=(256, 208), seed=99), noise_px=0.1)
    strangers = [
        dataclasses.replace(f, name=f"x{i}", timestamp_s=f.timestamp_s + 1e4)
        for i, f in enumerate(other)
    ]  # type: ignore[operator]
    placement = estimate(frames[:6] + strangers, reef)
    assert placement.components.tolist() == [0] * 6 + [1] * 4


@pytest.mark.slow
def test_nothing_but_blank_frames_is_an_error(reef: ReefFrames, frames: list[SurveyFrame]) -> None:
    with pytest.raises(MappingError, match="no two frames overlap"):
        estimate([blank(f) for f in frames[:3]], reef, ALONE)


@pytest.mark.slow
def test_noisy_navigation_as_a_prior_gives_place_and_pictures_give_shape(
    reef: ReefFrames, frames: list[SurveyFrame]
) -> None:
    truth = reef.trajectory.T_world_camera[:6]
    rng = np.random.default_rng(1)
    noisy = truth.copy()
    noisy[:, :3, 3] += rng.normal(0, 0.3, (6, 3)) * [1, 1, 0.1]
    stds = np.array([0.3, 0.3, 0.03]), 0.02
    priors = [pose_graph.Prior(i, T, *stds) for i, T in enumerate(noisy)]
    given = Placement(noisy, np.zeros(6, np.int64))
    T = odometry.fit(followed(frames[:6], reef), given, priors).T_world_camera
    assert trajectory_error(T[:, :3, 3], truth[:, :3, 3]).rms_m < 0.02
    assert np.abs(T[:, :2, 3] - truth[:, :2, 3]).max() < 0.4
    assert np.abs(T[:, 2, 3] - truth[:, 2, 3]).max() < 0.05


def ring(count: int = 12) -> np.ndarray:
    T = np.tile(np.eye(4), (count, 1, 1))
    for i in range(count):
        angle = 2 * np.pi * i / count
        T[i, :3, :3] = rotation_from_vector(np.array([0, 0, angle]))
        T[i, :3, 3] = np.cos(angle), np.sin(angle), 0
    return T


def edge(T: np.ndarray, i: int, j: int, off: np.ndarray | None = None) -> Edge:
    relation = inverse(T[i]) @ T[j]
    if off is not None:
        relation[:3, 3] += off
    return Edge(i, j, relation, np.diag([1e-4] * 3 + [1e-4] * 3), 100, loop=abs(j - i) > 3)


def test_the_pose_graph_spreads_drift_and_rejects_a_false_loop() -> None:
    T = ring()
    rng = np.random.default_rng(5)
    chain = [edge(T, i, i + 1, rng.normal(0, 0.01, 3)) for i in range(11)]
    loops = [edge(T, 0, 11), edge(T, 0, 10), edge(T, 1, 11), edge(T, 2, 8, np.array([1.0, 0, 0]))]
    drifted = T + 0
    for i in range(11):
        drifted[i + 1] = drifted[i] @ chain[i].T_i_j
    solved, rejected = pose_graph.solve(drifted, range(12), chain + loops)
    assert [(e.i, e.j) for e in rejected] == [(2, 8)]
    assert np.abs(solved[:, :3, 3] - T[:, :3, 3]).max() < 0.03


@pytest.mark.slow
def test_frames_whose_files_are_out_of_order_lose_no_loop_and_keep_their_track(
    reef: ReefFrames, frames: list[SurveyFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second file first: neighbors in time are six files apart, and neighbors among the files
    are loops.
    """
    shuffle = [0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11]
    graphs = []
    real = pose_graph.solve
    monkeypatch.setattr(pose_graph, "solve", lambda *args: graphs.append(args[2]) or real(*args))
    placement = estimate([frames[i] for i in shuffle], reef)
    assert placement.components.tolist() == [0] * 12
    for edge in graphs[-1]:
        assert edge.loop == (abs(shuffle[edge.i] - shuffle[edge.j]) > odometry.SETTINGS.window)
    error = trajectory_error(
        placement.T_world_camera[:, :3, 3], reef.trajectory.T_world_camera[shuffle, :3, 3]
    )
    assert error.fraction < 0.002


def test_priors_hold_the_map_to_navigation() -> None:
    T = ring()
    T[:, :3, 3] += [100, 200, -8]
    chain = [edge(T, i, i + 1, np.array([0, 0, 0.02])) for i in range(11)]
    priors = [pose_graph.Prior(i, T[i], np.array([0.5, 0.5, 0.01]), 0.01) for i in range(12)]
    start = inverse(T[0]) @ T
    solved, _ = pose_graph.solve(
        odometry.move_to_priors(priors, start, list(range(12))), range(12), chain, priors
    )
    assert np.abs(solved[:, 2, 3] + 8).max() < 0.03
    assert np.abs(solved[:, :2, 3] - T[:, :2, 3]).max() < 0.3


@pytest.mark.slow
def test_without_gtsam_the_map_is_made_and_says_what_is_missing(
    reef: ReefFrames, frames: list[SurveyFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "gtsam", None)
    placement = estimate(frames[:3], reef)
    assert (
        "loops were not closed, because GTSAM is missing: pip install 'stereo-seecolor[slam]'"
        in placement.warnings[0]
    )
    with pytest.raises(DeviceError, match="GTSAM"):
        pose_graph.solve(ring(), range(12), [])
