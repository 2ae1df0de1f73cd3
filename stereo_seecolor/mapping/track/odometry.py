"""Stereo odometry: poses of the frames from what they show."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import inverse, nearest_rotation, rigid_transform, transform_points
from stereo_seecolor.compute.sequences import Changed
from stereo_seecolor.errors import MappingError
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.survey_frames import Unplaced
from stereo_seecolor.mapping.track import loops as loop_closure
from stereo_seecolor.mapping.track import pose_graph
from stereo_seecolor.mapping.track.components import agreeing, chain
from stereo_seecolor.mapping.track.feature_store import FeatureStore
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.image_errors import find_image_errors
from stereo_seecolor.mapping.track.place_recognition import by_appearance
from stereo_seecolor.mapping.track.relative_pose import Edge, ExpectedPose, RelativePose
from stereo_seecolor.mapping.track.track_work import Ends, refit, relate, seen_pair, store_features
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class OdometrySettings:
    """How the track is followed."""

    window: int = 3  # frames back that each new frame is measured against: bridges two bad frames
    loop_rounds: int = 2  # of looking for loops: overlap is better known after the first


SETTINGS = OdometrySettings()


@dataclass(frozen=True, eq=False)
class Guess:
    """Poses (N, 4, 4) and components (N,) as they are known so far."""

    T: Array
    components: NDArray[np.int64]

    def expected(self, frames: NDArray[np.int64], sure: bool) -> ExpectedPose | None:
        """The relative pose of two frames; None for frames of two components."""
        i, j = frames
        if self.components[i] < 0 or self.components[i] != self.components[j]:
            return None
        return ExpectedPose(inverse(self.T[i]) @ self.T[j], sure)


@dataclass(eq=False)
class Track:
    """A track while it is followed. features: of every frame, in the order of time. edges: measured
    so far.

    reasons: why a frame has no edge, by number. links: edges that only say which frames are
    connected, by navigation.
    found: what was measured between the frames at two positions on the track, None where they do
    not see the same.
    """

    survey: Survey
    features: Sequence[Features] = ()
    edges: list[Edge] = field(default_factory=list)
    reasons: dict[int, str] = field(default_factory=dict)
    links: list[Edge] = field(default_factory=list)
    found: dict[Ends, RelativePose | None] = field(default_factory=dict)

    def measure(
        self,
        pairs: Iterable[Ends],
        what: str,
        loop: bool = False,
        guess: Guess | None = None,
        sure: bool = False,
    ) -> list[Edge]:
        """Measure the relative poses of frames at pairs of positions on the track, each pair once;
        return their edges. what: for the progress.

        guess: where the frames are thought to be, so that features are looked for there first;
        sure: as ``ExpectedPose``.
        """
        new = [ends for ends in pairs if ends not in self.found]
        expected = [
            guess.expected(self.survey.index.order[list(ends)], sure) if guess else None
            for ends in new
        ]
        work = partial(relate, self.features, self.survey.geometry)
        relations = self.survey.compute.each(work, zip(new, expected, strict=True))
        for done, (ends, relation) in enumerate(zip(new, relations, strict=True), 1):
            self.found[ends] = relation
            self.survey.progress(what, done, len(new))
        order = self.survey.index.order
        return [
            Edge.of(order, *ends, relation, loop) for ends in new if (relation := self.found[ends])
        ]

    def take_out_image_errors(self) -> None:
        """Correct all features for errors common to the images, and measure the edges again."""
        known = [(ends, relation) for ends, relation in self.found.items() if relation]
        pairs = Changed(known, partial(seen_pair, self.features))
        survey = self.survey
        errors = find_image_errors(pairs, survey.geometry, survey.index.less_sharp)
        if errors is None:
            return
        self.features = Changed(self.features, errors.corrected)
        again = list(self.survey.compute.each(partial(refit, self.features), known))
        self.found |= {ends: relation for (ends, _), relation in zip(known, again, strict=True)}
        self.edges = [
            Edge.of(self.survey.index.order, *ends, relation)
            for (ends, _), relation in zip(known, again, strict=True)
        ]

    def scaled(self, scale: float) -> "Track":
        """Scale the ranges of the rig by a factor."""
        return replace(
            self,
            features=Changed(self.features, partial(Features.scaled, scale=scale)),
            edges=[edge.scaled(scale) for edge in self.edges],
            found={
                ends: relation.scaled(scale) if relation else None
                for ends, relation in self.found.items()
            },
        )

    def relation(self, edge: Edge) -> tuple[Ends, RelativePose]:
        """Find what an edge was made from: its frames' positions, and their common points."""
        ends = int(self.survey.index.rank[edge.i]), int(self.survey.index.rank[edge.j])
        relation = self.found[ends]
        assert relation is not None, "it was measured"
        return ends, relation


def follow(survey: Survey) -> Track:
    """Measure each frame, in the order of time, against the ones before it; then again without the
    errors that all images have.

    The last frame comes first; its poses tell where to search earlier frames.
    """
    track = _featured(survey)
    guess: Guess | None = None
    for steps in range(1, SETTINGS.window + 1):
        pairs = [(here - steps, here) for here in range(steps, len(track.features))]
        what = "following the track" if steps == 1 else f"estimating the track, {steps} frames back"
        track.edges += track.measure(pairs, what, guess=guess, sure=True)
        guess = Guess(*chain(track.edges, survey.index.rank)) if track.edges else None
    track.take_out_image_errors()
    return track


def _featured(survey: Survey) -> Track:
    """A track on which the features of all frames are known, and nothing else."""
    order, store = survey.index.order.tolist(), FeatureStore.of(survey)
    track = Track(
        survey, store, reasons=dict.fromkeys(order, "it does not overlap any other frame")
    )
    work = partial(store_features, survey.frames, survey.geometry, order, store)
    for done, lost in enumerate(survey.compute.each(work, range(len(order)))):
        track.reasons |= {order[done]: lost} if lost else {}
        survey.progress("finding features", done + 1, len(order))
    return track


def solve(track: Track, rounds: int = SETTINGS.loop_rounds) -> Placement:
    """Place the frames by their edges, loops, and a pose graph over all.

    The world is the first placed frame's camera. Frames that match no other are named; frames that
    only match among themselves make a component of their own. rounds: of looking for loops.
    Raises MappingError if no two frames match.
    """
    if not track.edges:
        raise MappingError("no two frames overlap: the track cannot be estimated; give --poses")
    index = track.survey.index
    guess = Guess(*chain(track.edges, index.rank))
    warnings: list[str] = []
    if rounds and pose_graph.available():
        guess = _close_loops(track, guess, rounds)
    elif rounds:
        warnings.append(
            "loops were not closed, because GTSAM is missing: pip install "
            "'stereo-seecolor[slam]' (GTSAM)"
        )
    unplaced = tuple(
        Unplaced(index.names[i], track.reasons[int(i)])
        for i in np.flatnonzero(guess.components < 0)
    )
    placement = Placement(guess.T, guess.components, unplaced, tuple(warnings))
    if len(placement.sizes) > 1:
        sizes = ", ".join(str(n) for n in placement.sizes)
        placed = index.order[guess.components[index.order] >= 0].tolist()
        i, j = next(
            (i, j) for i, j in pairwise(placed) if guess.components[i] != guess.components[j]
        )
        where = f"first between {index.names[i]} and {index.names[j]}"
        return placement.with_warnings(
            f"the track is broken into {len(placement.sizes)} components of {sizes} frames, {where}"
        )
    return placement


def fit(track: Track, given: Placement, priors: Sequence[pose_graph.Prior]) -> Placement:
    """Place the frames by all edges that were measured, loops included, and by priors: those of
    ``given``'s frames.

    Frames that the images do not connect keep their place by priors, in components of ``given``.
    """
    index = track.survey.index
    for component in range(len(given.sizes)):
        frames = given.frames_of(component)
        frames = frames[np.argsort(index.rank[frames])]
        for i, j in pairwise(frames.tolist()):
            T_i_j = inverse(given.T_world_camera[i]) @ given.T_world_camera[j]
            track.links.append(Edge(i, j, T_i_j, np.eye(6), 0))
    guess = _settle(track, Guess(*chain(track.edges + track.links, index.rank)), priors)
    for prior in priors:  # a single frame is not a component of the chain
        if guess.components[prior.frame] < 0:
            guess.T[prior.frame] = prior.T_world_camera
            guess.components[prior.frame] = guess.components.max() + 1
    lost = {frame.name: frame.reason for frame in given.unplaced}
    names = [index.names[i] for i in np.flatnonzero(guess.components < 0)]
    return Placement(
        guess.T,
        guess.components,
        tuple(Unplaced(name, lost[name]) for name in names),
        given.warnings,
    )


def _close_loops(track: Track, guess: Guess, rounds: int) -> Guess:
    """Solve; then find loops and solve again, in rounds: overlap is better known after each."""
    guess = _settle(track, guess)
    for number in range(rounds):
        inside, joins = _sorted_loops(track, guess, _measure_loops(track, guess, number))
        joins = agreeing(joins, guess.T, guess.components)
        track.edges += inside + joins
        if joins:
            guess = Guess(*chain(track.edges, track.survey.index.rank))
        guess = _settle(track, guess)
    return guess


def _sorted_loops(
    track: Track, guess: Guess, loops: Sequence[Edge]
) -> tuple[list[Edge], list[Edge]]:
    """The plausible loops inside a component, and those that join two components."""
    index = track.survey.index
    lengths_m = loop_closure.lengths_m(guess.T, index.order)
    inside, joins = [], []
    for edge in loops:
        first, second = guess.components[edge.i], guess.components[edge.j]
        if first < 0 or second < 0:
            continue
        if first != second:
            joins.append(edge)
        elif loop_closure.is_plausible(edge, guess.T, lengths_m[index.rank[[edge.i, edge.j]]]):
            inside.append(edge)
    return inside, joins


def _measure_loops(track: Track, guess: Guess, number: int) -> list[Edge]:
    """The edges of candidates that were not tried yet; by appearance in round 0 only."""
    index, rank = track.survey.index, track.survey.index.rank
    alike = by_appearance(track.features, track.survey.compute) if number == 0 else []
    candidates = set(loop_closure.possible(alike, index, guess.T, guess.components))
    candidates |= set(loop_closure.between_components(guess.components[index.order]))
    for component in range(guess.components.max() + 1):
        frames = np.flatnonzero(guess.components == component)
        ordered = frames[np.argsort(rank[frames])].tolist()
        points = ((int(rank[i]), transform_points(guess.T[i], index.points_m[i])) for i in ordered)
        candidates |= set(loop_closure.by_overlap(points, SETTINGS.window))
    return track.measure(
        sorted(candidates), f"closing loops, round {number + 1}", loop=True, guess=guess
    )


def _settle(track: Track, guess: Guess, priors: Sequence[pose_graph.Prior] = ()) -> Guess:
    """Solve each component; drop false loops, split what only they held, and solve again."""
    T, false = _solve(guess, track.edges, priors)
    if not false:
        return Guess(T, guess.components)
    dropped = {id(edge) for edge in false}
    track.edges = [edge for edge in track.edges if id(edge) not in dropped]
    _, components = chain(track.edges + track.links, track.survey.index.rank)
    T = np.where((components >= 0)[:, None, None], T, np.nan)
    return Guess(_solve(Guess(T, components), track.edges, priors)[0], components)


def _solve(
    guess: Guess, edges: Sequence[Edge], priors: Sequence[pose_graph.Prior]
) -> tuple[Array, list[Edge]]:
    T, rejected = guess.T, []
    for number in range(guess.components.max() + 1):
        frames = np.flatnonzero(guess.components == number).tolist()
        chosen = set(frames)
        own = [edge for edge in edges if edge.i in chosen and edge.j in chosen]
        known = [prior for prior in priors if prior.frame in chosen]
        T, bad = pose_graph.solve(move_to_priors(known, T, frames), frames, own, known)
        rejected += bad
    return T, rejected


def move_to_priors(priors: Sequence[pose_graph.Prior], T: Array, frames: Sequence[int]) -> Array:
    """Move the frames as a whole to where the priors say, so that the solver starts near."""
    if not priors:
        return T
    offsets = np.stack([prior.T_world_camera @ inverse(T[prior.frame]) for prior in priors])
    R = nearest_rotation(offsets[:, :3, :3].mean(axis=0))
    positions = np.stack([T[prior.frame, :3, 3] for prior in priors])
    targets = np.stack([prior.T_world_camera[:3, 3] for prior in priors])
    moved = T.copy()
    moved[frames] = (
        rigid_transform(R, targets.mean(axis=0) - R @ positions.mean(axis=0)) @ T[frames]
    )
    return moved
