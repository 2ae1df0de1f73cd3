"""A check at a few places of the dive whether given poses are as exact as the map can show, so that
no track must be followed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.transforms import inverse, transform_points
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.survey_frames import Frames
from stereo_seecolor.mapping.track.features import Features, FeatureSettings
from stereo_seecolor.mapping.track.loops import Pairs, by_overlap
from stereo_seecolor.mapping.track.relative_pose import Edge, relative_pose
from stereo_seecolor.mapping.track.track_work import features_of

QUICK = FeatureSettings(max_width_px=480, max_features=800)
"""A quarter of the track's pixels: a pose is exact to some millimeters, at a fifth of the cost."""


@dataclass(frozen=True)
class SpotSettings:
    """How poses are checked, and when they are exact."""

    neighbors: int = 12  # pairs of neighbors, spread over the dive
    # pairs that overlap by the given poses, not neighbors: lines that lie side by side
    crossings: int = 6
    point_step: int = 16  # every so many of a frame's coarse points is enough to say where it looks
    min_edges: int = 5  # fewer prove nothing
    found: float = 0.5  # of the pairs of neighbors must have been measured
    # nine of ten pairs must agree to so many voxels at the surface: less does not show in the map
    voxels: float = 0.5
    worst_voxels: float = 1.0  # and all of them to so many


SETTINGS = SpotSettings()


def spot_check(survey: Survey, given: Placement, voxel_m: float) -> tuple[list[Edge], bool]:
    """Measure a few relative poses, and whether given ones agree with them to half a voxel."""
    order = survey.index.order
    placed = [rank for rank in range(len(order)) if given.components[order[rank]] >= 0]
    neighbors = [(a, b) for a, b in pairwise(placed) if _joined(given, order[[a, b]])]
    neighbors = _thinned(neighbors, SETTINGS.neighbors)
    points = (
        (a, transform_points(given.T_world_camera[order[a]], _points(survey, order[a])))
        for a in placed
    )
    crossings = [pair for pair in by_overlap(points, 1) if _joined(given, order[list(pair)])]
    edges = _measured(survey, sorted({*neighbors, *_thinned(crossings, SETTINGS.crossings)}))
    found = sum(abs(survey.index.rank[e.i] - survey.index.rank[e.j]) == 1 for e in edges)
    if len(edges) < SETTINGS.min_edges or found < SETTINGS.found * len(neighbors):
        return edges, False
    off_m = np.array([_off_m(edge, given, _points(survey, edge.j)) for edge in edges])
    limits_m = SETTINGS.voxels * voxel_m, SETTINGS.worst_voxels * voxel_m
    return edges, bool(np.quantile(off_m, 0.9) < limits_m[0] and off_m.max() < limits_m[1])


def _measured(survey: Survey, pairs: Pairs) -> list[Edge]:
    order = survey.index.order
    ranks = sorted({rank for pair in pairs for rank in pair})
    features: dict[int, Features] = {}
    work = partial(_quick_features, survey.frames, survey.geometry)
    found = survey.compute.each(work, [int(order[rank]) for rank in ranks])
    for rank, own in zip(ranks, found, strict=True):
        features[rank] = own
        survey.progress("checking the given poses", len(features), len(ranks))
    relations = ((a, b, relative_pose(features[a], features[b], survey.geometry)) for a, b in pairs)
    return [Edge.of(order, a, b, relation) for a, b, relation in relations if relation]


def _quick_features(frames: Frames, geometry: RectifiedPair, number: int) -> Features:
    return features_of(frames[number], geometry, QUICK)


def _off_m(edge: Edge, given: Placement, points_m: NDArray[np.floating]) -> float:
    """Median distance between a frame's points by the given and by the measured relative pose."""
    T = inverse(given.T_world_camera[edge.i]) @ given.T_world_camera[edge.j]
    if not len(points_m):
        return float("inf")
    return float(
        np.median(
            np.linalg.norm(
                transform_points(T, points_m) - transform_points(edge.T_i_j, points_m), axis=1
            )
        )
    )


def _points(survey: Survey, frame: int) -> NDArray[np.float32]:
    return survey.index.points_m[frame][:: SETTINGS.point_step]


def _joined(given: Placement, frames: NDArray[np.int64]) -> bool:
    """True for frames of one component: those of two have no given pose relative to each other."""
    return len(set(given.components[frames].tolist())) == 1


def _thinned(pairs: Sequence[tuple[int, int]], count: int) -> Pairs:
    return list(pairs[:: -(-len(pairs) // count) or 1])
