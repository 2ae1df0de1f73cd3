"""Refinement of a placement by bundle adjustment of all points of its relative poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.transforms import inverse
from stereo_seecolor.compute.process import return_freed
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track import pose_graph
from stereo_seecolor.mapping.track.bundle_adjustment import Adjusted, adjust
from stereo_seecolor.mapping.track.bundle_problem import BundleProblem
from stereo_seecolor.mapping.track.fiducials import Marks
from stereo_seecolor.mapping.track.odometry import Track
from stereo_seecolor.mapping.track.pose_graph import Prior
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.mapping.track.shared_points import observations
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class RefinementSettings:
    """How much is adjusted at once."""

    # 0.45 GiB, half a minute; with fewer than 400 a frame nothing is won
    most_observations: int = 1_000_000
    # on average: what views of more overlap have beyond that leaves no less error
    most_a_frame: int = 1200
    most_frames: int = 2500  # so many have 400 each; longer tracks are adjusted by windows
    window: int = 1000  # frames, which then keep all of their observations
    # frames that two windows share, several times the reach of an edge between neighbors
    overlap: int = 50


SETTINGS = RefinementSettings()


def refined(
    track: Track, placement: Placement, priors: Sequence[Prior] = (), marks: Marks | None = None
) -> Placement:
    """The placement's frames where all observations, the priors and the measured markers agree
    best, with standard errors.

    track: it holds the relative poses that the placement was made from; loops that turned out false
    are no longer among them.
    Very long components are adjusted by windows, and these joined by a pose graph with all loops,
    without standard errors or marks. Raises DeviceError if GTSAM is missing.
    """
    rank, T = track.survey.index.rank, placement.T_world_camera
    std = np.full((len(T), 2), np.nan)
    for component in range(len(placement.sizes)):
        track.survey.progress("adjusting the track", component, len(placement.sizes))
        frames = sorted(placement.frames_of(component).tolist(), key=lambda frame: int(rank[frame]))
        edges = _within(track.edges, frames)
        known = [prior for prior in priors if placement.components[prior.frame] == component]
        if len(frames) > SETTINGS.most_frames:
            T = _by_windows(T, track, frames, edges, known)
        elif edges:
            here = marks if component == 0 else None
            adjusted = _adjusted(T, track, frames, edges, known, here)
            T, std = adjusted.T_world_camera, np.where(np.isfinite(adjusted.std), adjusted.std, std)
    return_freed()
    return replace(
        placement,
        T_world_camera=T,
        position_std_m=std[:, 0],
        attitude_std_deg=np.degrees(std[:, 1]),
    )


def _adjusted(
    T: Array,
    track: Track,
    frames: Sequence[int],
    edges: Sequence[Edge],
    priors: Sequence[Prior] = (),
    marks: Marks | None = None,
) -> Adjusted:
    """Poses (N, 4, 4) of frames, in the order of time, by the edges between them."""
    most = min(SETTINGS.most_observations, SETTINGS.most_a_frame * len(frames))
    found = observations(track.features, [track.relation(edge) for edge in edges], most)
    found = replace(found, frame=track.survey.index.order[found.frame])
    found, known = marks.joined(found, set(frames)) if marks else (found, [])
    problem = BundleProblem.of(found, priors, known)
    del found  # the problem holds it, too, in another order
    return_freed()
    return adjust(T, problem, track.survey.geometry, track.survey.index.less_sharp)


def _within(edges: Sequence[Edge], frames: Sequence[int]) -> list[Edge]:
    chosen = set(frames)
    return [edge for edge in edges if edge.i in chosen and edge.j in chosen]


def _by_windows(
    T: Array,
    track: Track,
    frames: Sequence[int],
    left: list[Edge],
    priors: Sequence[Prior],
) -> Array:
    """Poses (N, 4, 4) by a pose graph whose edges are the adjusted ones, each of the first window
    that holds both of its frames. left: all edges.
    """
    every, edges = left, list[Edge]()
    for start in range(0, len(frames), SETTINGS.window - SETTINGS.overlap):
        window = frames[start : start + SETTINGS.window]
        within = _within(every, window)
        if not within:
            continue
        better, inside = _adjusted(T, track, window, within).T_world_camera, set(map(id, within))
        edges += [
            replace(e, T_i_j=inverse(better[e.i]) @ better[e.j]) for e in left if id(e) in inside
        ]
        left = [edge for edge in left if id(edge) not in inside]
    return pose_graph.solve(T, frames, edges + left, priors)[0]
