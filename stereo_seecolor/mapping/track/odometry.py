"""Own stereo odometry: poses from what the frames show, for surveys that come without."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.geometry import inverse, rotation_vector
from stereo_seecolor.mapping.frame_index import FrameIndex, Progress, silent
from stereo_seecolor.mapping.recovered import Frames, Unplaced
from stereo_seecolor.mapping.track import loop_closure, pose_graph
from stereo_seecolor.mapping.track.features import Features, detect
from stereo_seecolor.mapping.track.placement import Placement
from stereo_seecolor.mapping.track.relative_pose import Edge, relate

WINDOW = pose_graph.TRACK
"""Frames back that each new frame is measured against."""
MIN_PIECE = 2
LOOP_TURNS = 2
JOIN_EDGES = 2
JOIN_M = 0.3
JOIN_RAD = 0.1
DRIFT_SHARE = 0.05
DRIFT_M = 0.5


@dataclass(eq=False)
class _Survey:
    """What is known while the track grows. features: of every frame. edges: relations measured so far."""

    pair: RectifiedPair
    features: dict[int, Features] = field(default_factory=dict)
    edges: list[Edge] = field(default_factory=list)
    tried: set[tuple[int, int]] = field(default_factory=set)

    def relate(self, i: int, j: int) -> Edge | None:
        """Measure a pair of frames once."""
        if (i, j) in self.tried:
            return None
        self.tried.add((i, j))
        return relate(i, self.features[i], j, self.features[j], self.pair)


def estimate(
    frames: Frames,
    pair: RectifiedPair,
    config: MappingConfig,
    index: FrameIndex,
    priors: Sequence[pose_graph.Prior] = (),
    progress: Progress = silent,
) -> Placement:
    """Place the frames by their own pictures: relations to the last three frames, loops, and a pose graph over all.

    The world is the first placed frame's camera; ``upright`` levels it. With priors (navigation, depth, attitude) it is
    theirs, and pieces that pictures cannot join keep their place by them.
    Frames that match no other are named; frames that only match among themselves make a piece of their own.
    Raises MappingError if no two frames match.
    """
    order = index.order.tolist()
    survey = _Survey(pair)
    reasons = dict.fromkeys(order, "it shows nothing that another frame shows")
    for done, i in enumerate(order):
        frame = frames[i]
        if isinstance(frame, Unplaced):
            reasons[i], survey.features[i] = frame.reason, Features.none()
        else:
            survey.features[i] = detect(frame, pair)
        for back in order[max(0, done - WINDOW) : done][::-1]:
            if edge := survey.relate(back, i):
                survey.edges.append(edge)
        progress("following the track", done + 1, len(order))
    if not survey.edges:
        raise MappingError("no two frames show the same things: the track cannot be followed; give --poses")
    T, pieces = _chain(survey.edges, len(order), order)
    warnings: list[str] = []
    if priors or (config.loop_closure and pose_graph.available()):
        T, pieces = _close_loops(survey, index, T, pieces, order, priors, LOOP_TURNS if config.loop_closure else 0, progress)
    elif config.loop_closure:
        warnings.append("loops were not closed: pip install 'stereo-seecolor[slam]' (GTSAM)")
    unplaced = tuple(Unplaced(index.names[i], reasons[int(i)]) for i in np.flatnonzero(pieces < 0))
    if pieces.max() > 0:
        sizes = ", ".join(str(n) for n in np.bincount(pieces[pieces >= 0]))
        warnings.append(f"the track is broken into {pieces.max() + 1} pieces of {sizes} frames")
    return Placement(T, pieces, unplaced, tuple(warnings))


def priors_from(placement: Placement, config: MappingConfig) -> list[pose_graph.Prior]:
    """What navigation says of each frame, with the errors that the configuration gives it."""
    position = np.array([config.prior_position_std_m, config.prior_position_std_m, config.prior_depth_std_m])
    attitude = float(np.radians(config.prior_attitude_std_deg))
    placed = np.flatnonzero(placement.pieces >= 0)
    return [pose_graph.Prior(int(i), placement.T_world_camera[i], position, attitude) for i in placed]


def _chain(edges: Sequence[Edge], count: int, order: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """First guess: each piece hung together by its strongest edges; the largest is piece 0, lone frames are -1."""
    neighbors: dict[int, list[tuple[int, int, int, NDArray[np.float64]]]] = {i: [] for i in range(count)}
    for edge in edges:
        neighbors[edge.i].append((-edge.inliers, edge.i, edge.j, edge.T_i_j))
        neighbors[edge.j].append((-edge.inliers, edge.j, edge.i, inverse(edge.T_i_j)))
    T = np.full((count, 4, 4), np.nan)
    groups = [_grow(start, neighbors, T) for start in order if np.isnan(T[start, 0, 0])]
    pieces = np.full(count, -1)
    for number, group in enumerate(sorted((g for g in groups if len(g) >= MIN_PIECE), key=len, reverse=True)):
        pieces[group] = number
    T[pieces < 0] = np.nan
    return T, pieces


def _grow(start: int, neighbors: dict[int, list[tuple[int, int, int, NDArray[np.float64]]]], T: NDArray[np.float64]) -> list[int]:
    """Prim's tree from one frame: always the strongest edge to a frame that has no pose; fills T, returns the frames."""
    T[start] = np.eye(4)
    group, waiting = [start], [edge[:3] for edge in neighbors[start]]
    step = {edge[1:3]: edge[3] for edge in neighbors[start]}
    heapq.heapify(waiting)
    while waiting:
        _, i, j = heapq.heappop(waiting)
        if np.isfinite(T[j, 0, 0]):
            continue
        T[j] = T[i] @ step[i, j]
        group.append(j)
        for edge in neighbors[j]:
            step[edge[1:3]] = edge[3]
            heapq.heappush(waiting, edge[:3])
    return group


def _close_loops(
    survey: _Survey,
    index: FrameIndex,
    T: NDArray[np.float64],
    pieces: NDArray[np.int64],
    order: Sequence[int],
    priors: Sequence[pose_graph.Prior],
    turns: int,
    progress: Progress,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Solve; then find loops by appearance and by overlap and solve again, so often, since overlap is better known each time."""
    T, pieces = _settle(survey, T, pieces, order, priors)
    for turn in range(turns):
        candidates = set(loop_closure.by_appearance(survey.features)) if turn == 0 else set()
        candidates |= set(loop_closure.between_pieces(pieces))
        for number in range(pieces.max() + 1):
            candidates |= set(loop_closure.by_overlap(index, T, np.flatnonzero(pieces == number).tolist(), WINDOW))
        loops = []
        for done, (i, j) in enumerate(sorted(candidates)):
            if edge := survey.relate(i, j):
                loops.append(edge)
            progress("closing loops", done + 1, len(candidates))
        inside = [e for e in loops if pieces[e.i] == pieces[e.j] >= 0 and _plausible(e, T, order)]
        joins = _agreeing([e for e in loops if pieces[e.i] != pieces[e.j] and min(pieces[e.i], pieces[e.j]) >= 0], T, pieces)
        survey.edges += inside + joins
        if joins:
            T, pieces = _chain(survey.edges, len(order), order)
        T, pieces = _settle(survey, T, pieces, order, priors)
    return T, pieces


def _settle(
    survey: _Survey, T: NDArray[np.float64], pieces: NDArray[np.int64], order: Sequence[int], priors: Sequence[pose_graph.Prior]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Solve each piece; drop the false loops, let pieces fall apart that only they held together, and solve again."""
    T, false = _solve(T, pieces, survey.edges, priors)
    if false:
        dropped = {id(edge) for edge in false}
        survey.edges = [edge for edge in survey.edges if id(edge) not in dropped]
        _, pieces = _chain(survey.edges, len(order), order)
        T = np.where((pieces >= 0)[:, None, None], T, np.nan)
        T, _ = _solve(T, pieces, survey.edges, priors)
    return T, pieces


def _solve(
    T: NDArray[np.float64], pieces: NDArray[np.int64], edges: Sequence[Edge], priors: Sequence[pose_graph.Prior]
) -> tuple[NDArray[np.float64], list[Edge]]:
    rejected: list[Edge] = []
    for number in range(pieces.max() + 1):
        frames = np.flatnonzero(pieces == number).tolist()
        chosen = set(frames)
        own = [edge for edge in edges if edge.i in chosen and edge.j in chosen]
        known = [prior for prior in priors if prior.frame in chosen]
        T, bad = pose_graph.solve(_moved_to(known, T, frames), frames, own, known)
        rejected += bad
    return T, rejected


def _moved_to(priors: Sequence[pose_graph.Prior], T: NDArray[np.float64], frames: Sequence[int]) -> NDArray[np.float64]:
    """The piece as a whole brought to where the priors say, so that the solver starts near."""
    if not priors:
        return T
    offsets = np.stack([prior.T_world_camera @ inverse(T[prior.frame]) for prior in priors])
    U, _, Vt = np.linalg.svd(offsets[:, :3, :3].mean(axis=0))
    move = np.eye(4)
    move[:3, :3] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    positions = np.stack([T[prior.frame, :3, 3] for prior in priors])
    targets = np.stack([prior.T_world_camera[:3, 3] for prior in priors])
    move[:3, 3] = targets.mean(axis=0) - move[:3, :3] @ positions.mean(axis=0)
    moved = T.copy()
    moved[frames] = move @ T[frames]
    return moved


def _plausible(edge: Edge, T: NDArray[np.float64], order: Sequence[int]) -> bool:
    """A loop may contradict the track by what a track can drift on the way, and no more."""
    off = inverse(T[edge.i]) @ T[edge.j]
    contradiction_m = float(np.linalg.norm(off[:3, 3] - edge.T_i_j[:3, 3]))
    between = sorted((order.index(edge.i), order.index(edge.j)))
    centers = T[list(order[between[0] : between[1] + 1]), :3, 3]
    steps = np.linalg.norm(np.diff(centers[np.isfinite(centers).all(axis=1)], axis=0), axis=1)
    return contradiction_m < DRIFT_M + DRIFT_SHARE * float(steps.sum())


def _agreeing(edges: list[Edge], T: NDArray[np.float64], pieces: NDArray[np.int64]) -> list[Edge]:
    """Edges that join two pieces count only if at least two of them put the pieces to the same place."""

    def joint(edge: Edge) -> NDArray[np.float64]:
        return np.asarray(T[edge.i] @ edge.T_i_j @ inverse(T[edge.j]))

    def agree(a: Edge, b: Edge) -> bool:
        if {pieces[a.i], pieces[a.j]} != {pieces[b.i], pieces[b.j]}:
            return False
        first, second = joint(a), joint(b) if pieces[a.i] == pieces[b.i] else inverse(joint(b))
        at_a, at_b = first @ T[a.j], second @ T[a.j]
        turn = np.linalg.norm(rotation_vector(first[:3, :3].T @ second[:3, :3]))
        return float(np.linalg.norm(at_a[:3, 3] - at_b[:3, 3])) < JOIN_M and float(turn) < JOIN_RAD

    return [edge for edge in edges if sum(agree(edge, other) for other in edges) >= JOIN_EDGES]
