"""Deviations in given positions that are read rightly: their scale, and places where they jump
against the pictures.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.errors import counted
from calibration.geometry import RectifiedPair
from stereo_seecolor.geometry import inverse, rotation_vector, transformed
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.kept_frames import Frames, Unplaced
from stereo_seecolor.mapping.survey import Placement, Survey
from stereo_seecolor.mapping.track.features import Features, FeatureSettings, detect
from stereo_seecolor.mapping.track.loops import Pairs, by_overlap
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.mapping.track.track_work import Relating

# Residuals of given poses against the relative poses that the pictures show.

Array = NDArray[np.float64]

SAME_PIXEL = 0.02
"""Two points lie in the same direction if their normalized image coordinates differ by less: about
a coarse point's spacing.
"""


@dataclass(frozen=True, eq=False)
class Motions:
    """Relative poses of E edges as given, and as measured, both (E, 4, 4), p_i = T_i_j p_j."""

    given: Array
    measured: Array

    @classmethod
    def of(cls, T_world_camera: Array, edges: Sequence[Edge]) -> "Motions":
        """The edges whose frames both have a pose."""
        posed = [e for e in edges if np.isfinite(T_world_camera[[e.i, e.j]]).all()]
        i, j = [e.i for e in posed], [e.j for e in posed]
        measured = np.array([e.T_i_j for e in posed]).reshape(-1, 4, 4)
        return cls(inverse(T_world_camera[i]) @ T_world_camera[j], measured)

    @property
    def position_m(self) -> Array:
        """The distance between the given and the measured shift: (E,) meters."""
        return np.asarray(np.linalg.norm(self.given[:, :3, 3] - self.measured[:, :3, 3], axis=1))

    @property
    def attitude_rad(self) -> Array:
        """The angle between the given and the measured rotation: (E,)."""
        if not len(self.given):
            return np.zeros(0)
        turns = np.swapaxes(self.measured[:, :3, :3], 1, 2) @ self.given[:, :3, :3]
        return np.asarray(np.linalg.norm(rotation_vector(turns), axis=1))

    @property
    def step_m(self) -> float:
        """Median measured shift."""
        return (
            float(np.median(np.linalg.norm(self.measured[:, :3, 3], axis=1)))
            if len(self.measured)
            else float("nan")
        )


def by_frame(values: Array, edges: Sequence[Edge], count: int) -> Array:
    """Compute the median of values (E,) over each frame's edges: (count,), NaN for a frame without
    edges.
    """
    ends = np.array([[e.i, e.j] for e in edges], np.int64).reshape(-1, 2)
    result = np.full(count, np.nan)
    for frame in np.unique(ends):
        result[frame] = np.median(values[(ends == frame).any(axis=1)])
    return result


def depth_difference_m(
    points_i: NDArray[np.floating], points_j: NDArray[np.floating], T_i_j: Array
) -> float:
    """Median distance along the rays of frame i between what it saw and what frame j saw in the
    same directions.

    points_i, points_j: (n, 3) in each camera. NaN where the two do not overlap by this pose.
    """
    seen = transformed(T_i_j, points_j)
    seen = seen[seen[:, 2] > 0]
    if not len(points_i) or not len(seen):
        return float("nan")
    apart, nearest = cKDTree(points_i[:, :2] / points_i[:, 2:]).query(
        seen[:, :2] / seen[:, 2:], distance_upper_bound=SAME_PIXEL
    )
    both = np.isfinite(apart)
    off_m = points_i[np.asarray(nearest)[both], 2] - seen[both, 2]
    return float(np.median(np.abs(off_m))) if both.any() else float("nan")


@dataclass(frozen=True)
class DeviationSettings:
    """When a deviation is reported.

    On a real dive of 20 pairs (steps of 0.13 m) noise of 20 cm gives at most 2.6 times the median
    between two frames, and a scale 0.6 standard errors off; a drift of half a meter looks like a
    scale 2.8 standard errors off.
    """

    min_edges: int = 8  # fewer do not tell their scatter
    least_scale: float = 0.02  # calibrations in water are known to a percent or better
    sigmas: float = 4.0
    least_jump_m: float = 0.05  # less is no more than navigation's noise
    times_median: float = 6.0  # of what frames that follow each other are off
    # of what a single position is off: frames before and after it tell the same to so much
    alike: float = 0.5
    most_frames: int = 3  # an edge over more frames does not tell between which of them


DEVIATIONS_SETTINGS = DeviationSettings()


def deviations(T_world_camera: Array, edges: Sequence[Edge], index: FrameIndex) -> list[str]:
    """A line for the scale of given positions, T (N, 4, 4), and one for their jumps, where the
    edges of the pictures show them.
    """
    posed = [e for e in edges if np.isfinite(T_world_camera[[e.i, e.j]]).all()]
    if len(posed) < DEVIATIONS_SETTINGS.min_edges:
        return []
    return [
        *_scale(Motions.of(T_world_camera, posed), posed),
        *_jumps(T_world_camera, posed, index),
    ]


def _scale(motions: Motions, edges: Sequence[Edge]) -> list[str]:
    """Long steps count most. Noise of positions lengthens steps, noise of attitudes shortens what
    lies along the measured one: the scale is what both show.
    """
    given, measured = motions.given[:, :3, 3], motions.measured[:, :3, 3]
    squared = (measured**2).sum(axis=1)
    along, length = (
        (given * measured).sum(axis=1) / squared,
        np.sqrt((given**2).sum(axis=1) / squared),
    )
    frames = len({frame for e in edges for frame in (e.i, e.j)})
    found = []
    for ratios in (along, length):
        middle = _weighted_median(ratios, squared)
        # a normal's standard deviation
        scatter = 1.4826 * _weighted_median(np.abs(ratios - middle), squared)
        found.append((middle, 1.2533 * scatter / np.sqrt(frames)))  # the standard error of a median
    scale, std = min(found, key=lambda one: abs(one[0] - 1))
    one_way = (found[0][0] - 1) * (found[1][0] - 1) > 0
    if not one_way or abs(scale - 1) < max(
        DEVIATIONS_SETTINGS.least_scale, DEVIATIONS_SETTINGS.sigmas * std
    ):
        return []
    return [
        f"the given positions are {scale:.3f} ± {std:.3f} times as far apart as in the pictures: "
        "their scale is off, or the calibration's (square size, baseline, calibrated in air)"
    ]


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _jumps(T: Array, edges: Sequence[Edge], index: FrameIndex) -> list[str]:
    """Between frames that follow each other: how far given positions are off, by all edges over
    that place.
    """
    motions = Motions.of(T, edges)
    rank = index.rank[[[e.i, e.j] for e in edges]]
    off_m = np.einsum(
        "nij,nj->ni",
        T[[e.i for e in edges], :3, :3],
        motions.given[:, :3, 3] - motions.measured[:, :3, 3],
    )
    off_m *= np.sign(rank[:, 1] - rank[:, 0])[:, None]
    first, last = rank.min(axis=1), rank.max(axis=1)
    if (last - first > DEVIATIONS_SETTINGS.most_frames).all():
        return []
    steps = [
        np.flatnonzero((last - first > step) & (last - first <= DEVIATIONS_SETTINGS.most_frames))
        for step in range(DEVIATIONS_SETTINGS.most_frames)
    ]
    edge, place = (
        np.concatenate(steps),
        np.concatenate([first[over] + step for step, over in enumerate(steps)]),
    )
    by_place = np.argsort(place, kind="stable")
    places, starts = np.unique(place[by_place], return_index=True)
    # at 1 + the rank of the frame before, between neighbors that are never off
    jump_m = np.zeros(len(index.order) + 1)
    jump_m[1 + places] = [
        np.linalg.norm(np.median(off_m[own], axis=0))
        for own in np.split(edge[by_place], starts[1:])
    ]
    limit_m = max(
        DEVIATIONS_SETTINGS.least_jump_m,
        DEVIATIONS_SETTINGS.times_median * float(np.median(jump_m[1 + places])),
    )
    peak = (jump_m[1:-1] > limit_m) & (jump_m[1:-1] >= jump_m[:-2]) & (jump_m[1:-1] > jump_m[2:])
    if not peak.any():
        return []
    worst = int(np.argmax(np.where(peak, jump_m[1:-1], 0)))
    for frame in (worst, worst + 1):
        if (alone_m := _alone_m(off_m[last == frame], -off_m[first == frame])) > limit_m:
            peak[max(frame - 1, 0) : frame + 1] = False
            line = (
                f"the given position of {index.names[index.order[frame]]} is {alone_m:.2f} m "
                "off against the pictures"
            )
            return [
                line
                + (f", and more jump at {counted(int(peak.sum()), 'place')}" if peak.any() else "")
            ]
    a, b = (index.names[index.order[place]] for place in (worst, worst + 1))
    more = f", and at {peak.sum() - 1} more places" if peak.sum() > 1 else ""
    return [
        f"the given positions jump by {jump_m[worst + 1]:.2f} m against the pictures between {a} "
        f"and {b}{more}"
    ]


def _alone_m(before: Array, after: Array) -> float:
    """How far a single position is off, by the edges (n, 3) to frames before it and after it; 0
    where they do not tell the same.
    """
    if not len(before) or not len(after):
        return 0.0
    both = np.median(before, axis=0), np.median(after, axis=0)
    off_m = float(np.linalg.norm(both[0] + both[1]) / 2)
    return off_m if np.linalg.norm(both[0] - both[1]) < DEVIATIONS_SETTINGS.alike * off_m else 0.0


# A check at a few places of the dive whether given poses are as exact as the map can show, so
# that no track must be followed.

QUICK = FeatureSettings(max_width_px=480, max_features=800)
"""A quarter of the track's pixels: a pose is told to some millimeters, at a fifth of the cost."""


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


SPOT_CHECK_SETTINGS = SpotSettings()


@dataclass(frozen=True, eq=False)
class Spots:
    """Edges measured here and there; exact: True where the given poses agree with them to half a
    voxel.
    """

    edges: list[Edge]
    exact: bool


def spot_check(survey: Survey, given: Placement, voxel_m: float) -> Spots:
    """Measure a few relative poses and hold given ones against them."""
    order = survey.index.order
    placed = [rank for rank in range(len(order)) if given.components[order[rank]] >= 0]
    neighbors = [(a, b) for a, b in pairwise(placed) if _joined(given, order[[a, b]])]
    neighbors = _thinned(neighbors, SPOT_CHECK_SETTINGS.neighbors)
    points = (
        (a, transformed(given.T_world_camera[order[a]], _points(survey, order[a]))) for a in placed
    )
    crossings = [pair for pair in by_overlap(points, 1) if _joined(given, order[list(pair)])]
    edges = _measured(
        survey, sorted({*neighbors, *_thinned(crossings, SPOT_CHECK_SETTINGS.crossings)})
    )
    found = sum(abs(survey.index.rank[e.i] - survey.index.rank[e.j]) == 1 for e in edges)
    if len(edges) < SPOT_CHECK_SETTINGS.min_edges or found < SPOT_CHECK_SETTINGS.found * len(
        neighbors
    ):
        return Spots(edges, False)
    off_m = np.array([_off_m(edge, given, _points(survey, edge.j)) for edge in edges])
    limits_m = SPOT_CHECK_SETTINGS.voxels * voxel_m, SPOT_CHECK_SETTINGS.worst_voxels * voxel_m
    return Spots(edges, bool(np.quantile(off_m, 0.9) < limits_m[0] and off_m.max() < limits_m[1]))


def _measured(survey: Survey, pairs: Pairs) -> list[Edge]:
    order = survey.index.order
    ranks = sorted({rank for pair in pairs for rank in pair})
    features: list[Features] = []
    for found in survey.compute.each(
        _QuickDetection(survey.frames, survey.geometry), [int(order[rank]) for rank in ranks]
    ):
        features.append(found)
        survey.progress("looking at the given poses", len(features), len(ranks))
    place = {rank: i for i, rank in enumerate(ranks)}
    relating = Relating(features, survey.geometry)
    relations = ((a, b, relating(((place[a], place[b]), None))) for a, b in pairs)
    return [
        Edge(int(order[a]), int(order[b]), r.T_a_b, r.covariance, len(r.index_a))
        for a, b, r in relations
        if r
    ]


@dataclass(frozen=True, eq=False)
class _QuickDetection:
    """Finds the features of the frame of a number, as an object that can be sent to another
    process.
    """

    frames: Frames
    geometry: RectifiedPair

    def __call__(self, number: int) -> Features:
        frame = self.frames[number]
        return (
            Features.none() if isinstance(frame, Unplaced) else detect(frame, self.geometry, QUICK)
        )


def _off_m(edge: Edge, given: Placement, points_m: NDArray[np.floating]) -> float:
    """Median distance between a frame's points by the given and by the measured relative pose."""
    T = inverse(given.T_world_camera[edge.i]) @ given.T_world_camera[edge.j]
    if not len(points_m):
        return float("inf")
    return float(
        np.median(
            np.linalg.norm(transformed(T, points_m) - transformed(edge.T_i_j, points_m), axis=1)
        )
    )


def _points(survey: Survey, frame: int) -> NDArray[np.float32]:
    return survey.index.points_m[frame][:: SPOT_CHECK_SETTINGS.point_step]


def _joined(given: Placement, frames: NDArray[np.int64]) -> bool:
    """True for frames of one component: those of two have no given pose relative to each other."""
    return len(set(given.components[frames].tolist())) == 1


def _thinned(pairs: Sequence[tuple[int, int]], count: int) -> Pairs:
    return list(pairs[:: -(-len(pairs) // count) or 1])
