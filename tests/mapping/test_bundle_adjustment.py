"""Bundle adjustment: truer poses than the pose graph's, errors as large as they say, what the
residuals teach of the ranges.
"""

import tracemalloc
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from mapping_scene import ReefFrames
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.transforms import inverse, rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track import bundle_problem, odometry, placement_refinement
from stereo_seecolor.mapping.track.bundle_adjustment import Adjusted, adjust
from stereo_seecolor.mapping.track.bundle_problem import BundleProblem
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.flattened_relief import flattened_relief
from stereo_seecolor.mapping.track.image_errors import disparity_errors
from stereo_seecolor.mapping.track.image_space import Observed
from stereo_seecolor.mapping.track.placement_refinement import RefinementSettings, refined
from stereo_seecolor.mapping.track.pose_graph import Prior, solve
from stereo_seecolor.mapping.track.relative_pose import Edge, RelativePose, fit_pose
from stereo_seecolor.mapping.track.shared_points import Relation, TrackObservations, observations
from stereo_seecolor.sharpness import EQUALLY_SHARP, LessSharpSide

Array = NDArray[np.float64]
MOST = 1_000_000
STATED = np.array([4e-4, 4e-4, 4e-3])
GEOMETRY = RectifiedPair(
    focal_px=400.0,
    cx_left_px=240.0,
    cx_right_px=240.0,
    cy_px=200.0,
    baseline_m=0.12,
    image_size=(480, 400),
)


@dataclass(frozen=True)
class Line:
    """A straight line of frames over points on a rough bottom: each frame's features, and which
    points they are.
    """

    T: Array
    features: list[Features]
    points: list[NDArray[np.int64]]

    @property
    def relations(self) -> list[Relation]:
        """Of each frame with the next three."""
        return [self.relation(i, j) for j in range(len(self.T)) for i in range(max(0, j - 3), j)]

    def relation(self, i: int, j: int) -> Relation:
        """Of two frames, fitted to what both see."""
        _, index_i, index_j = np.intersect1d(self.points[i], self.points[j], return_indices=True)
        a, b = (
            Observed(self.features[k].points[index], self.features[k].std[index])
            for k, index in ((i, index_i), (j, index_j))
        )
        T, covariance, _ = fit_pose(inverse(self.T[i]) @ self.T[j], a, b)
        return (i, j), RelativePose(T, covariance, index_i, index_j)


def line(true_std: Array, frames: int = 12, seed: int = 1) -> Line:
    """Features are off by ``true_std``, and state STATED."""
    rng = np.random.default_rng(seed)
    places = np.column_stack(
        [
            rng.uniform(-1.5, 0.4 * frames + 1.5, 900),
            rng.uniform(-1, 1, 900),
            rng.uniform(-0.2, 0.2, 900),
        ]
    )
    down = rotation_from_vector(np.array([np.pi, 0, 0]))
    T = np.stack(
        [
            rigid_transform(down @ rotation_from_vector(rng.normal(0, 0.05, 3)), [0.4 * i, 0, 1.8])
            for i in range(frames)
        ]
    )
    features, points = [], []
    for own in T:
        local = transform_points(inverse(own), places)
        seen = np.column_stack([local[:, :2], np.ones(len(local))]) / local[:, 2:]
        inside = np.flatnonzero((np.abs(seen[:, 0]) < 0.6) & (np.abs(seen[:, 1]) < 0.5))
        off = true_std * rng.standard_normal((len(inside), 3))
        features.append(
            Features(
                seen[inside] + off,
                np.tile(STATED, (len(inside), 1)),
                (seen[inside] + off)[:, 2],
                np.zeros((len(inside), 128), np.uint8),
            )
        )
        points.append(inside)
    return Line(T, features, points)


def by_pose_graph(scene: Line, relations: Sequence[Relation]) -> Array:
    edges = [Edge(i, j, r.T_a_b, r.covariance, len(r.index_a)) for (i, j), r in relations]
    start = scene.T.copy()
    for i in range(1, len(start)):
        start[i] = start[i - 1] @ next(e.T_i_j for e in edges if (e.i, e.j) == (i - 1, i))
    return solve(start, range(len(start)), edges)[0]


def off_m(T: Array, scene: Line) -> Array:
    return np.asarray(np.linalg.norm(T[:, :3, 3] - scene.T[:, :3, 3], axis=1))


def problem_of(scene: Line, priors: Sequence[Prior] = ()) -> BundleProblem:
    return BundleProblem.of(observations(scene.features, scene.relations, MOST), priors)


def adjusted(scene: Line) -> tuple[Adjusted, Array]:
    """By bundle adjustment, and by the pose graph that it starts from."""
    relations = scene.relations
    start = by_pose_graph(scene, relations)
    return adjust(start, problem_of(scene), GEOMETRY), start


def test_exact_sightings_give_exact_poses() -> None:
    scene = line(np.zeros(3), frames=5)
    start = scene.T.copy()
    start[1:, :3, 3] += np.random.default_rng(0).normal(0, 0.02, (4, 3))
    found = adjust(start, problem_of(scene), GEOMETRY)
    assert found.T_world_camera == pytest.approx(scene.T, abs=1e-5)


@pytest.mark.slow
def test_a_track_is_the_same_to_the_last_bit_on_any_number_of_cores(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, found = line(STATED), []
    start = by_pose_graph(scene, scene.relations)
    for cores in (1, 3):
        with ThreadPoolExecutor(cores) as pool:
            monkeypatch.setattr(bundle_problem, "core_pool", lambda pool=pool: pool)
            found.append(adjust(start, problem_of(scene), GEOMETRY))
    assert np.array_equal(found[0].T_world_camera, found[1].T_world_camera)
    assert np.array_equal(found[0].std, found[1].std)


@pytest.mark.slow
def test_a_track_is_truer_than_by_the_pose_graph_and_as_far_off_as_it_says() -> None:
    ends = []
    for seed in range(8):
        scene = line(STATED, seed=seed)
        found, start = adjusted(scene)
        ends.append(
            (off_m(start, scene)[-1], off_m(found.T_world_camera, scene)[-1], found.std[-1, 0])
        )
    graph, bundle, stated = np.sqrt((np.array(ends) ** 2).mean(axis=0))
    assert bundle < 0.9 * graph
    assert bundle == pytest.approx(stated, rel=0.5)


@pytest.mark.slow
def test_errors_of_the_disparity_that_all_frames_share_are_in_the_standard_errors() -> None:
    """Ranges almost exact, but ramps and bends of the disparity, drawn for each track."""
    ends = []
    for seed in range(8):
        scene, rng = line(STATED * [1, 1, 0.02], seed=seed), np.random.default_rng(seed)
        sizes = rng.standard_normal(5)
        shared = [
            replace(
                own,
                points=own.points
                + np.outer(sizes @ [*disparity_errors(own.points, GEOMETRY)], [0, 0, 1]),
                std=own.std * [1, 1, 0.02],
            )
            for own in scene.features
        ]
        found, _ = adjusted(replace(scene, features=shared))
        ends.append((off_m(found.T_world_camera, scene)[-1], found.std[-1, 0]))
    off, stated = np.sqrt((np.array(ends) ** 2).mean(axis=0))
    assert off == pytest.approx(stated, rel=0.5)


def test_the_disparitys_slopes_of_a_refined_rig_are_in_the_standard_errors() -> None:
    """A right focal length wrong by its standard error shifts ranges over the image as stated,
    along the baseline, however the images lie.
    """
    points, slopes = line(STATED, frames=1).features[0].points, (0.004, 0.002)
    unit = 1 / GEOMETRY.baseline_m  # the inverse depth of a disparity of one focal length
    for turns, (x, y) in ((0, slopes), (1, slopes[::-1]), (2, slopes)):
        geometry = replace(GEOMETRY, quarter_turns=turns, slope_std=slopes)
        along_x, along_y, *bends = disparity_errors(points, geometry)
        assert along_x == pytest.approx(x * points[:, 0] * unit, rel=0.01)
        assert along_y == pytest.approx(y * points[:, 1] * unit, rel=0.01)
        for bend, plain in zip(bends, [*disparity_errors(points, GEOMETRY)][2:], strict=True):
            assert np.array_equal(bend, plain)
    scene = line(STATED, frames=4)
    sure, unsure = (
        adjust(scene.T, problem_of(scene), replace(GEOMETRY, slope_std=slope_std)).std[-1, 0]
        for slope_std in ((0.0, 0.0), slopes)
    )
    assert unsure > 2 * sure


def flattened(own: Features, by: float) -> Features:
    """Features whose relief windows flatten by this fraction; a narrower window does not."""
    plane = np.column_stack([own.points[:, :2], np.ones(len(own.points))])
    level = plane @ np.linalg.lstsq(plane, own.points[:, 2])[0]
    inverse = own.points[:, 2] + by * (level - own.points[:, 2])
    return replace(own, points=np.column_stack([own.points[:, :2], inverse]))


@pytest.mark.slow
def test_relief_that_windows_flatten_is_in_the_standard_errors() -> None:
    """As it lengthens a track: without it the ends were 13 standard errors off."""
    ends = []
    for seed in range(4):
        scene = line(STATED * [1, 1, 0.2], seed=seed)
        features = [
            flattened(replace(own, std=own.std * [1, 1, 0.2]), 0.1) for own in scene.features
        ]
        found, _ = adjusted(replace(scene, features=features))
        ends.append((off_m(found.T_world_camera, scene)[-1], found.std[-1, 0]))
    off, stated = np.sqrt((np.array(ends) ** 2).mean(axis=0))
    assert off == pytest.approx(stated, rel=0.4)


def test_standard_errors_by_relief_are_larger_where_a_side_is_blurred() -> None:
    scene = line(STATED * [1, 1, 0.2], frames=4)
    problem = problem_of(scene)
    problem = replace(problem, near=1.1 * problem.near)
    sharp, blurred = (
        adjust(scene.T, problem, GEOMETRY, LessSharpSide("right", contrast)).std[-1, 0]
        for contrast in (1.0, 0.25)
    )
    assert blurred > 2 * sharp


def test_relief_no_larger_than_noise_may_be_smoothed_away() -> None:
    """All of it at most, and nothing of a plane."""
    scene = line(STATED * [1, 1, 0.01], frames=3)
    problem = problem_of(scene)
    for noise, most in ((1e-6, 0.01), (1.0, 1.0)):
        weight = np.full_like(problem.weight, 1 / noise)
        averaged, smoothed = flattened_relief(replace(problem, weight=weight))
        relief = problem.seen[:, 2] - problem.seen[:, 2].mean()
        assert np.abs(averaged).max() < 1e-12
        assert (smoothed @ relief) / (relief @ relief) == pytest.approx(most, abs=0.2)
    plane = 0.5 + 0.1 * problem.seen[:, :2].sum(axis=1)
    flat = replace(problem, seen=np.column_stack([problem.seen[:, :2], plane]), near=plane)
    for error in flattened_relief(flat):
        assert np.abs(error).max() < 1e-9


def test_without_sightings_nothing_moves() -> None:
    nothing = TrackObservations(
        np.zeros(0, np.int64),
        np.zeros(0, np.int64),
        Observed(np.zeros((0, 3)), np.zeros((0, 3))),
        np.zeros(0),
    )
    T = line(STATED, frames=3).T
    found = adjust(T, BundleProblem.of(nothing), GEOMETRY)
    assert found.T_world_camera == pytest.approx(T)
    assert np.isnan(found.std).all()


def test_residuals_teach_how_far_to_trust_directions_and_ranges() -> None:
    found, _ = adjusted(line(STATED * [0.5, 0.5, 2.0], frames=8))
    assert found.scale == pytest.approx((0.5, 2.0), rel=0.15)


def test_poor_navigation_is_averaged_out_and_places_the_track() -> None:
    scene, rng = line(STATED, frames=8), np.random.default_rng(5)
    priors = []
    for i, T in enumerate(scene.T):
        noisy = T @ rigid_transform(rotation_from_vector(rng.normal(0, 0.01, 3)), np.zeros(3))
        noisy[:3, 3] += rng.normal(0, 0.05, 3)
        priors.append(Prior(i, noisy, np.full(3, 0.05), 0.01))
    given = np.array([prior.T_world_camera for prior in priors])
    found = adjust(given, problem_of(scene, priors), GEOMETRY)
    steps, true_steps = (np.diff(T[:, :3, 3], axis=0) for T in (found.T_world_camera, scene.T))
    assert np.abs(steps - true_steps).max() < 0.005
    assert off_m(found.T_world_camera, scene).max() < 0.06
    assert (found.std[:, 0] > 0.01).all()


def test_features_of_one_thing_are_one_point_and_contradictions_are_none() -> None:
    def relation(a: int, b: int, *pairs: tuple[int, int]) -> Relation:
        index_a, index_b = np.array(pairs).T
        return (a, b), RelativePose(np.eye(4), np.eye(6), index_a, index_b)

    features = [
        Features(
            np.arange(30.0).reshape(10, 3) + 100 * k,
            np.ones((10, 3)),
            np.zeros(10),
            np.zeros((10, 128), np.uint8),
        )
        for k in range(3)
    ]
    found = observations(
        features,
        [relation(0, 1, (0, 5), (1, 6)), relation(1, 2, (5, 7), (6, 8)), relation(0, 2, (2, 8))],
        MOST,
    )
    assert found.frame.tolist() == [0, 1, 2]  # 1-6-8-2: frame 0 shows it twice
    assert found.point.tolist() == [0, 0, 0]
    assert found.seen.points[:, 0].tolist() == [0, 115, 221]


def test_of_too_many_sightings_each_relation_keeps_those_seen_most_often() -> None:
    scene = line(STATED, frames=8)
    everything, few = (observations(scene.features, scene.relations, most) for most in (MOST, 400))
    assert len(few.frame) <= 400 < len(everything.frame)
    assert set(few.frame.tolist()) == set(range(8))
    assert np.bincount(few.point).mean() > np.bincount(everything.point).mean()


@pytest.mark.slow
def test_a_long_track_is_adjusted_by_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Truer than by the pose graph alone, and nearly as by one adjustment of all."""
    ends = []
    for seed in range(8):
        scene = line(STATED, frames=16, seed=seed)
        relations = scene.relations
        start = by_pose_graph(scene, relations)
        edges = [Edge(i, j, r.T_a_b, r.covariance, len(r.index_a)) for (i, j), r in relations]
        index = SimpleNamespace(rank=np.arange(16), order=np.arange(16), less_sharp=EQUALLY_SHARP)
        survey = SimpleNamespace(index=index, geometry=GEOMETRY, progress=lambda *_: None)
        track = odometry.Track(survey, scene.features, edges, found=dict(relations))  # type: ignore[arg-type]
        placement, found = Placement(start, np.zeros(16, np.int64)), []
        for settings in (
            RefinementSettings(),
            RefinementSettings(most_frames=10, window=8, overlap=4),
        ):
            monkeypatch.setattr(placement_refinement, "SETTINGS", settings)
            found.append(refined(track, placement).T_world_camera)
        ends.append([off_m(T, scene)[-1] for T in (start, *found)])
    graph, whole, windows = np.sqrt((np.array(ends) ** 2).mean(axis=0))
    assert whole < 0.9 * graph
    assert windows < 0.97 * graph


@pytest.mark.slow
def test_a_track_over_a_drawn_reef_gets_truer_with_standard_errors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Larger ones where a side is blurred, of which the errors of the image know, too."""
    reef = ReefFrames(
        SurveySpec(pairs=8, lines=1, image_size=(320, 256), seed=3, pair_spacing_m=0.3),
        noise_px=0.1,
    )
    frames = [reef[i] for i in range(len(reef))]
    index, blurred = FrameIndex.build(frames, reef.pair), LessSharpSide("right", 0.1)
    sides: list[LessSharpSide] = []
    monkeypatch.setattr(odometry, "find_image_errors", lambda *given: sides.append(given[2]))
    of_blurred = odometry.follow(Survey(frames, reef.pair, replace(index, less_sharp=blurred)))
    assert sides == [blurred]
    track = replace(of_blurred, survey=Survey(frames, reef.pair, index))
    own = odometry.solve(track, rounds=0)
    better = refined(track, own)
    truth = reef.trajectory.T_world_camera
    off = [
        np.linalg.norm(
            (inverse(truth[0]) @ truth[-1])[:3, 3]
            - (inverse(p.T_world_camera[0]) @ p.T_world_camera[-1])[:3, 3]
        )
        for p in (own, better)
    ]
    assert off[1] < 0.005
    assert better.position_std_m is not None
    assert (np.diff(better.position_std_m) > 0).all()
    assert better.position_std_m[-1] < 0.02
    less_sure = refined(of_blurred, own).position_std_m
    assert less_sure is not None
    assert less_sure[-1] > 1.2 * better.position_std_m[-1]


def test_points_seen_once_do_not_exist() -> None:
    scene = line(STATED, frames=4)
    found = observations(scene.features, scene.relations, MOST)
    assert isinstance(found, TrackObservations)
    assert np.bincount(found.point).min() >= 2


def test_sums_over_observations_are_gone_before_the_equations_are_made() -> None:
    frames, each, views = 240, 600, 12
    rng = np.random.default_rng(3)
    points = frames * each // views
    point = np.repeat(np.arange(points), views)
    frame = ((7 * point + rng.integers(0, frames // views, len(point))) % frames).astype(np.int64)
    frame = (frame + np.tile(np.arange(views), points) * (frames // views)) % frames
    seen = np.column_stack([rng.uniform(-0.3, 0.3, (len(point), 2)), np.full(len(point), 0.5)])
    weight = np.full(seen.shape, 1e3)
    problem = BundleProblem(
        np.arange(frames),
        point,
        frame,
        seen,
        weight,
        seen[:, 2],
        [Prior(0, np.eye(4), np.ones(3), 1.0)],
        [],
    )
    T = np.broadcast_to(np.eye(4), (frames, 4, 4))
    state = bundle_problem.State(T, problem.first_places(T))
    problem.linearize(state)  # makes what the problem keeps
    tracemalloc.start()
    step = problem.linearize(state)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    stays = (step.W, step.V, step.own_g, step.blocks.diagonal, step.blocks.below)
    sums = 8 * (3 * 3 + 3) * len(point)
    assert peak < sum(array.nbytes for array in stays) + sums
