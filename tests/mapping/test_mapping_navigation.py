"""Given poses are compared with the images: noise is averaged out, and numbers that were read
wrongly are named.
"""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from mapping_scene import CONFIG, PAIR, ReefFrames, flat_frame, track
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.map_errors import trajectory_error
from calibration.transforms import inverse, quaternion, rigid_transform, rotation_from_vector
from stereo_seecolor.cli.results import map_exit_code
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping import placing
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation import spot_check as spot_check_file
from stereo_seecolor.mapping.navigation.motions import Motions, depth_difference_m
from stereo_seecolor.mapping.navigation.mount import constant_turn, lever_arm
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion, spans_of
from stereo_seecolor.mapping.navigation.spot_check import QUICK, spot_check
from stereo_seecolor.mapping.placing import PlacedSurvey, by_pictures, place_survey
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.mapping.track import odometry
from stereo_seecolor.mapping.track.features import Features, detect
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import GeoOrigin, SurveyFrame, Trajectory

Poses = NDArray[np.float64]
R_ENU_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
ORIGIN = GeoOrigin(-23.5, 152.0)


class Seen(NamedTuple):
    """What the images alone say: the track before and after loops were looked for, and the frames
    placed by it; features by frame.
    """

    followed: odometry.Track
    own: Placement
    looped: odometry.Track
    features: dict[str, Features]


@pytest.fixture(scope="module")
def reef(flown_reef: ReefFrames) -> ReefFrames:
    return flown_reef


@pytest.fixture(scope="module")
def survey(reef: ReefFrames) -> Survey:
    frames = [reef[i] for i in range(len(reef))]
    return Survey(frames, reef.pair, FrameIndex.build(frames, reef.pair))


@pytest.fixture(scope="module")
def seen(survey: Survey, reef: ReefFrames) -> Seen:
    """The track as it is followed, with its loops, and the frames placed by it; the features that
    given poses are checked by.
    """
    track = odometry.follow(survey)
    followed = copy_of(track)
    features = {frame.name: detect(frame, reef.pair, QUICK) for frame in survey.frames}
    return Seen(followed, by_pictures(track), track, features)


def copy_of(track: odometry.Track) -> odometry.Track:
    """The track, so that what is done to its edges changes no other."""
    return replace(track, edges=[*track.edges], found={**track.found})


@pytest.fixture
def placed(
    survey: Survey, reef: ReefFrames, seen: Seen, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., PlacedSurvey]:
    """Places the survey by changed poses; the result from the images alone is computed once."""

    def own(track: odometry.Track) -> Placement:
        track.edges, track.found = [*seen.looped.edges], {**seen.looped.found}
        return seen.own

    monkeypatch.setattr(odometry, "follow", lambda _: copy_of(seen.followed))
    monkeypatch.setattr(placing, "by_pictures", own)
    monkeypatch.setattr(spot_check_file, "features_of", lambda frame, *_: seen.features[frame.name])

    def run(
        change: Callable[[Poses], Poses],
        config: MappingConfig | None = None,
        later_s: float = 0.0,
        step_m: float = 0.0,
    ) -> PlacedSurvey:
        true = reef.trajectory
        names = ("",) * len(true.names)
        T = change(true.T_world_camera.copy())
        times_s = true.timestamps_s + later_s
        given = Trajectory(names, times_s, T, origin=ORIGIN, position_step_m=step_m)
        return place_survey(survey, config or MappingConfig(), given)

    return run


def noisy(T: Poses, seed: int = 1) -> Poses:
    rng = np.random.default_rng(seed)
    T[:, :3, 3] += rng.normal(0, [0.1, 0.1, 0.03], (len(T), 3))
    T[:, :3, :3] = T[:, :3, :3] @ rotation_from_vector(rng.normal(0, np.radians(2), (len(T), 3)))
    return T


def positions(change: Callable[[Poses], Poses]) -> Callable[[Poses], Poses]:
    def changed(T: Poses) -> Poses:
        T[:, :3, 3] = change(T[:, :3, 3])
        return T

    return changed


def w_first(T: Poses) -> Poses:
    T[:, :3, :3] = Rotation.from_quat(np.roll(quaternion(T[:, :3, :3]), 1, axis=1)).as_matrix()
    return T


def turned_back(T: Poses) -> Poses:
    T[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    return T


def rounded(step_m: float) -> Callable[[Poses], Poses]:
    return positions(lambda p: np.column_stack([np.round(p[:, :2] / step_m) * step_m, p[:, 2]]))


def north_east_down(T: Poses) -> Poses:
    return np.asarray(rigid_transform(R_ENU_NED, np.zeros(3)) @ T)


def turned(degrees: float) -> Callable[[Poses], Poses]:
    return lambda T: (
        T @ rigid_transform(rotation_from_vector(np.radians([degrees, 0, 0])), np.zeros(3))
    )


def off_m(found: PlacedSurvey, reef: ReefFrames) -> float:
    T = found.placement.T_world_camera
    return trajectory_error(T[:, :3, 3], reef.trajectory.T_world_camera[:, :3, 3]).rms_m


@pytest.mark.slow
def test_true_poses_fit_and_stay(placed: Callable[..., PlacedSurvey], reef: ReefFrames) -> None:
    found = placed(lambda T: T)
    assert found.navigation is not None
    assert found.navigation.fits
    assert not found.navigation.advice
    assert found.navigation.position_residual_m < 0.005
    assert found.navigation.depth_residual_m == pytest.approx(
        found.navigation.depth_noise_m, rel=0.2
    )
    np.testing.assert_allclose(
        found.placement.T_world_camera[:, :3, 3],
        reef.trajectory.T_world_camera[:, :3, 3],
        atol=0.01,
    )


@pytest.mark.slow
def test_exact_poses_are_taken_as_they_are_without_a_track(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(odometry, "follow", lambda _: pytest.fail("the track was followed"))
    found = placed(lambda T: T, MappingConfig(voxel_m=0.03))
    assert found.navigation is not None
    assert found.navigation.relative_poses >= 10
    assert np.array_equal(found.placement.T_world_camera, reef.trajectory.T_world_camera)
    assert np.isfinite(found.position_residual_m).all()


@pytest.mark.slow
@pytest.mark.parametrize("off_m", [[0.0, 0.06, 0.0], [0.0, 0.0, 0.06]])
def test_a_line_that_lies_off_by_two_voxels_is_not_exact(
    survey: Survey, reef: ReefFrames, off_m: list[float]
) -> None:
    """Neighbors on each line agree; the surface would be doubled where the lines overlap."""
    T = reef.trajectory.T_world_camera.copy()
    assert spot_check(survey, Placement(T, np.zeros(12, np.int64)), 0.03)[1]
    T[6:, :3, 3] += off_m
    assert not spot_check(survey, Placement(T, np.zeros(12, np.int64)), 0.03)[1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_is_measured_and_averaged_out(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames, seed: int
) -> None:
    found = placed(lambda T: noisy(T, seed))
    navigation = found.navigation
    assert navigation is not None
    assert navigation.fits
    assert not navigation.advice
    assert 0.08 < navigation.position_residual_m < 0.25
    assert 0.05 < navigation.position_std_m < 0.2
    assert 0.01 < navigation.depth_std_m < 0.08
    assert 1.0 < navigation.attitude_std_deg < 4.0
    assert navigation.depth_residual_m > 2 * navigation.depth_noise_m
    assert off_m(found, reef) < 0.005
    assert np.isfinite(found.position_residual_m).all()


@pytest.mark.slow
@pytest.mark.parametrize("step_m", [0.3, 1.1, 11.0])
def test_rounded_positions_are_weighed_as_such_and_kept(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames, step_m: float
) -> None:
    """Steps between the frames are shorter than that: each seems to be somewhere else."""
    found = placed(rounded(step_m), step_m=step_m)
    navigation = found.navigation
    assert navigation is not None
    assert navigation.fits
    assert f"rounded to {step_m:.2g} m" in navigation.advice
    assert navigation.attitude_std_deg < 1.0
    assert found.origin == ORIGIN
    assert off_m(found, reef) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (w_first, "the quaternion's w first"),
        (inverse, "world-to-camera poses"),
        (positions(lambda p: p[:, [1, 0, 2]]), "x and y swapped"),
        (positions(lambda p: p * [-1, 1, 1]), "x mirrored"),
        (positions(lambda p: p * [1, -1, 1]), "y mirrored"),
        (positions(lambda p: p * [1, 1, -1]), "z pointing down"),
        (positions(lambda p: p @ R_ENU_NED.T), "positions north-east-down"),
        (north_east_down, "as north-east-down"),
        (positions(lambda p: p / 0.3048), "positions in feet"),
        (
            positions(lambda p: p @ rotation_from_vector(np.radians([0, 0, 25])).T),
            "positions rotated by -25 degrees",
        ),
        (lambda T: T[::-1], "the poses in the opposite order"),
        (turned_back, "the rotations inverted"),
        (lambda T: w_first(turned_back(T)), "w first and the rotations inverted"),
        (lambda T: turned_back(noisy(T)), "the rotations inverted"),
        (lambda T: w_first(noisy(T)), "the quaternion's w first"),
        (lambda T: inverse(noisy(T)), "world-to-camera poses"),
    ],
)
def test_poses_read_wrongly_are_named_and_left_out(
    placed: Callable[..., PlacedSurvey],
    reef: ReefFrames,
    change: Callable[[Poses], Poses],
    advice: str,
) -> None:
    found = placed(change)
    assert found.navigation is not None
    assert not found.navigation.fits
    assert advice in found.navigation.advice
    assert found.navigation.advice in found.placement.warnings
    assert off_m(found, reef) < 0.005


@pytest.mark.slow
def test_headings_in_radians_are_named_and_left_out(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames
) -> None:
    """The second line of the survey runs the other way; its headings differ by 3 instead of 180
    degrees.
    """

    def in_radians(T: Poses) -> Poses:
        turn = Rotation.from_matrix(T[:, :3, :3]) * Rotation.from_matrix(T[0, :3, :3]).inv()
        heading = np.unwrap(turn.as_euler("ZYX")[:, 0])
        back = Rotation.from_rotvec((np.radians(heading) - heading)[:, None] * [0.0, 0.0, 1.0])
        T[:, :3, :3] = (back * Rotation.from_matrix(T[:, :3, :3])).as_matrix()
        return T

    found = placed(in_radians)
    assert found.navigation is not None
    assert not found.navigation.fits
    assert found.origin is None
    assert off_m(found, reef) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("later_s", [1.0, -0.5])
def test_clocks_apart_are_named_with_the_difference(
    placed: Callable[..., PlacedSurvey], later_s: float
) -> None:
    found = placed(lambda T: T, later_s=later_s)
    assert found.navigation is not None
    assert f"{-later_s:+.2f} s added to the times of the poses" in found.navigation.advice


def one_attitude(T: Poses) -> Poses:
    T[:, :3, :3] = np.eye(3)
    return T


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (positions(lambda p: p * [1 / 111_000, 1 / 111_000, 1]), "latitudes and longitudes"),
        (positions(lambda p: 0 * p), "hardly move"),
        (one_attitude, "attitudes are all equal"),
    ],
)
def test_poses_that_stay_while_the_pictures_move_are_named(
    placed: Callable[..., PlacedSurvey],
    reef: ReefFrames,
    change: Callable[[Poses], Poses],
    said: str,
) -> None:
    found = placed(change)
    assert found.navigation and not found.navigation.fits and said in found.navigation.advice
    assert off_m(found, reef) < 0.01


@pytest.mark.slow
def test_a_forgotten_mount_angle_is_found_said_and_taken_into_account(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames
) -> None:
    for change in (turned(14.0), lambda T: turned(14.0)(noisy(T))):
        found = placed(change)
        assert found.navigation is not None
        assert found.navigation.fits
        assert (
            "the camera is rotated by 14." in found.navigation.advice
            or "by 13." in found.navigation.advice
        )
        assert "mapping.mount.rpy_deg=[-1" in found.navigation.advice
        assert off_m(found, reef) < 0.005
        down = found.placement.T_world_camera[:, 2, 2] - reef.trajectory.T_world_camera[:, 2, 2]
        assert np.abs(down).mean() < 0.03


def test_a_lever_arm_is_found_where_the_camera_turns() -> None:
    rng = np.random.default_rng(0)
    measured = np.array(
        [rigid_transform(rotation_from_vector(v[0]), v[1]) for v in rng.normal(0, 0.3, (30, 2, 3))]
    )
    arm = rigid_transform(np.eye(3), np.array([0.5, -0.2, 0.3]))
    seen = Motions(inverse(arm) @ measured @ arm, measured)
    found = lever_arm(seen)
    assert found is not None
    np.testing.assert_allclose(found[0], [0.5, -0.2, 0.3], atol=1e-4)
    assert (found[1] < 0.05).all()
    noise = seen.given.copy()
    noise[:, :3, 3] = measured[:, :3, 3] + rng.normal(0, 0.3, (30, 3))
    assert lever_arm(Motions(noise, measured)) is None
    assert lever_arm(Motions(measured, measured)) is None


@pytest.mark.slow
def test_positions_of_another_point_of_the_vehicle_are_said_and_moved(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames
) -> None:
    found = placed(lambda T: T @ rigid_transform(np.eye(3), np.array([0.5, 0.0, 0.0])))
    assert (
        found.navigation
        and found.navigation.fits
        and "a point 0.50 m from the camera" in found.navigation.advice
    )
    np.testing.assert_allclose(
        found.placement.T_world_camera[:, :3, 3],
        reef.trajectory.T_world_camera[:, :3, 3],
        atol=0.03,
    )


@pytest.mark.slow
def test_poses_of_another_dive_are_not_used(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames
) -> None:
    rng = np.random.default_rng(0)
    found = placed(
        lambda T: np.stack(
            [
                rigid_transform(rotation_from_vector(rng.normal(0, 2, 3)), rng.normal(0, 2, 3))
                for _ in T
            ]
        )
    )
    assert found.navigation is not None
    assert "do they belong to this dive?" in found.navigation.advice
    assert found.origin is None  # the map lies where its own first camera was
    assert off_m(found, reef) < 0.005


@pytest.mark.slow
def test_given_poses_are_the_maps_but_measured(
    placed: Callable[..., PlacedSurvey], reef: ReefFrames
) -> None:
    found = placed(noisy, MappingConfig(poses="given"))
    assert found.origin == ORIGIN
    np.testing.assert_array_equal(
        found.placement.T_world_camera, noisy(reef.trajectory.T_world_camera.copy())
    )
    assert found.navigation is not None
    assert found.navigation.position_residual_m > 0.08
    assert found.navigation.blurred and "more than a voxel apart" in str(found.navigation)
    exact = placed(lambda T: T, MappingConfig(poses="given")).navigation
    assert exact is not None and not exact.blurred
    with pytest.raises(MappingError, match="z axis points down"):
        placed(north_east_down, MappingConfig(poses="given"))


@pytest.mark.slow
def test_a_standard_error_of_the_configuration_is_used(placed: Callable[..., PlacedSurvey]) -> None:
    navigation = placed(noisy, MappingConfig(prior_position_std_m=0.3)).navigation
    assert navigation is not None
    assert navigation.position_std_m == 0.3


@pytest.mark.slow
def test_without_gtsam_poses_are_taken_as_given_and_it_is_said(
    placed: Callable[..., PlacedSurvey], monkeypatch: pytest.MonkeyPatch, reef: ReefFrames
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "gtsam", None)
    found = placed(noisy)
    assert "pip install 'stereo-seecolor[slam]'" in found.placement.warnings[-1]
    np.testing.assert_array_equal(
        found.placement.T_world_camera, noisy(reef.trajectory.T_world_camera.copy())
    )


@pytest.mark.slow
def test_poses_that_cannot_be_measured_are_used_and_end_with_3(tmp_path: Path) -> None:
    summary = build_map([flat_frame(i) for i in range(4)], PAIR, tmp_path, CONFIG, track(4))
    assert summary.placed == 4
    assert summary.navigation is not None
    assert "could not be compared with the images" in str(summary.navigation)
    assert map_exit_code(summary) == 3


@pytest.mark.slow
def test_frames_that_show_nothing_keep_their_place_by_navigation(
    tmp_path: Path, reef: ReefFrames, survey: Survey
) -> None:
    frames = [
        replace(f, color=np.full_like(f.color, 90)) if i in (0, 5, 6) else f
        for i, f in enumerate(survey.frames)
    ]  # type: ignore[arg-type, type-var]
    good: list[SurveyFrame] = frames[:9]  # type: ignore[assignment]
    summary = build_map(good, reef.pair, tmp_path, CONFIG, reef.trajectory)
    assert summary.components == (9,)
    with (tmp_path / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows if not row["position_residual_m"]] == [
        good[i].name for i in (0, 5, 6)
    ]
    x_m = [float(row["x_m"]) for row in rows]
    np.testing.assert_allclose(x_m, reef.trajectory.T_world_camera[:9, 0, 3], atol=0.02)


def test_a_constant_turn_is_found_from_shifts_and_turns() -> None:
    rng = np.random.default_rng(4)
    X = rotation_from_vector(np.array([0.1, -0.25, 0.3]))
    measured = np.stack(
        [
            rigid_transform(rotation_from_vector(rng.normal(0, 0.2, 3)), rng.normal(0, 0.5, 3))
            for _ in range(20)
        ]
    )
    turn = constant_turn(
        Motions(
            rigid_transform(X, np.zeros(3)) @ measured @ rigid_transform(X.T, np.zeros(3)), measured
        )
    )
    assert np.degrees(np.linalg.norm(Rotation.from_matrix(turn.R @ X.T).as_rotvec())) < 0.01
    assert turn.believed
    assert not constant_turn(Motions(measured, measured)).believed


def test_noisy_inverted_rotations_and_a_noisy_mount_are_told_apart() -> None:
    """Of a camera that looks down both tilt the poses; a vehicle that turns tells which it is."""
    rng = np.random.default_rng(7)
    down = Rotation.from_euler("x", 180, degrees=True)
    headings = np.repeat([0.0, 180.0], 12) + rng.normal(0, 5, 24)
    tilts = np.array([7.0, 0.0]) + rng.normal(0, 3, (24, 2))
    true = np.tile(np.eye(4), (24, 1, 1))
    turns = Rotation.from_euler("zxy", np.column_stack([headings, tilts]), degrees=True) * down
    true[:, :3, :3] = turns.as_matrix()
    true[:, 0, 3] = 0.8 * np.concatenate([np.arange(12), np.arange(12)[::-1]])
    true[12:, 1, 3] = 0.6
    near = [(i, j) for i in range(24) for j in range(i + 1, 24) if j == i + 1 or i + j == 23]
    edges = [Edge(i, j, inverse(true[i]) @ true[j], np.eye(6), 50) for i, j in near]
    own = Placement(true, np.zeros(24, np.int64))
    seen = SeenMotion(edges, spans_of(own, np.arange(24), np.ones(24, np.bool_)))
    for change, is_inverted in ((turned_back, True), (turned(14.0), False)):
        for seed in range(5):
            T = change(noisy(true.copy(), seed))
            turn = constant_turn(Motions.of(T, [*seen.edges, *seen.spans]))
            with_turn = T @ rigid_transform(turn.R, np.zeros(3))
            assert (seen.cost(turned_back(T.copy())) < seen.cost(with_turn)) == is_inverted


def test_depths_of_overlapping_frames_differ_by_what_a_pose_is_off() -> None:
    frame = FrameIndex.build([flat_frame(0)], PAIR).points_m[0]
    assert depth_difference_m(frame, frame, np.eye(4)) == pytest.approx(0, abs=1e-6)
    assert depth_difference_m(
        frame, frame, rigid_transform(np.eye(3), [0.1, 0, 0.07])
    ) == pytest.approx(0.07, abs=1e-3)
    assert np.isnan(depth_difference_m(frame, frame, rigid_transform(np.eye(3), [9.0, 0, 0])))
