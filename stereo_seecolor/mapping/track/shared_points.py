"""Points that several frames share: matched features joined where they are the same."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from stereo_seecolor.mapping.surface.surface import only_used
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.frame_blocks import Integers
from stereo_seecolor.mapping.track.image_space import Observed
from stereo_seecolor.mapping.track.relative_pose import RelativePose

Labels = NDArray[np.int32]
AT_ONCE = 1_000_000
"""Matches that are joined at once: SciPy takes some 40 bytes for each."""
Relation = tuple[tuple[int, int], RelativePose]
"""Two positions on the track, and their relative pose."""


@dataclass(frozen=True, eq=False)
class TrackObservations:
    """n observations of m points. frame: (n,) position on the track, point: (n,) number from 0 to m
    - 1, seen: (n,) as it was seen, near: (n,) as Features have it.
    """

    frame: Integers
    point: Integers
    seen: Observed
    near: NDArray[np.float64]


def observations(
    features: Sequence[Features], relations: Sequence[Relation], most: int
) -> TrackObservations:
    """Join the inliers of all relations to points; at most ``most`` points of each relation are
    kept, those seen most often.

    features: by position on the track. A point of which one frame shows two features is none: one
    of its matches is wrong.
    """
    frame, feature, point = _shared(relations, most)
    return TrackObservations(frame, point, *_observed(features, frame, feature))


def _shared(relations: Sequence[Relation], most: int) -> tuple[Integers, Integers, Integers]:
    """Frame, feature and number of the point of each observation that is kept."""
    frames = np.unique([ends for ends, _ in relations])
    stride = 1 + max(int(max(r.index_a.max(), r.index_b.max())) for _, r in relations)
    start = {frame: stride * k for k, frame in enumerate(frames.tolist())}
    sizes = [len(r.index_a) for _, r in relations]
    both = np.empty((2, sum(sizes)), np.int32)
    for end, (ends, r) in zip(np.cumsum(sizes), relations, strict=True):
        part = slice(end - len(r.index_a), end)
        both[0, part], both[1, part] = r.index_a + start[ends[0]], r.index_b + start[ends[1]]
    nodes, both = only_used(both, stride * len(frames))
    label = _joined(both, len(nodes))
    views = np.bincount(label).astype(np.int32)
    views[_seen_twice(label, nodes // stride)] = 0
    chosen = np.zeros(len(views), bool)
    chosen[_best(views, label[both[0]], np.cumsum(sizes), most)] = True
    kept = np.flatnonzero(chosen[label])
    point = np.unique(label[kept], return_inverse=True)[1]
    return frames[nodes[kept] // stride], nodes[kept] % stride, point


def _joined(matches: Labels, nodes: int) -> Labels:
    """(nodes,) numbers of the points that matches (2, n) join."""
    label: Labels = np.arange(nodes, dtype=np.int32)
    for start in range(0, matches.shape[1], AT_ONCE):
        a, b = label[matches[:, start : start + AT_ONCE]]
        points = int(label.max()) + 1
        graph = csr_array((np.ones(len(a), np.bool_), (a, b)), (points, points))
        label = connected_components(graph, directed=False)[1][label]
    return label


def _seen_twice(label: Labels, frame: Integers) -> Labels:
    """Labels that occur twice in a frame."""
    order = np.lexsort((frame, label))
    same = (np.diff(label[order]) == 0) & (np.diff(frame[order]) == 0)
    return np.unique(label[order][1:][same])


def _best(views: Labels, point: Labels, ends: Integers, most: int) -> Labels:
    """Points of whose observations there are at most so many: of each relation those with most
    views, equally many of each.

    point: (n,) of the matches, relation by relation; ends: of each relation in these.
    """
    place = np.empty(len(point), np.int32)
    for start, end in zip([0, *ends[:-1]], ends, strict=True):
        own = views[point[start:end]]
        order = np.argsort(-own, kind="stable")
        place[start + order] = np.arange(len(order))
        place[start:end][own == 0] = len(point)
    limit = int(place[place < len(point)].max(initial=0)) + 1
    while views[chosen := np.unique(point[place < limit])].sum() > most and limit > 1:
        limit = limit * 3 // 4
    return chosen


def _observed(
    features: Sequence[Features], frame: Integers, feature: Integers
) -> tuple[Observed, NDArray[np.float64]]:
    """Frames ascend: each is read once."""
    starts = np.flatnonzero(np.diff(frame, prepend=-1))
    parts = []
    for start, end in zip(starts, [*starts[1:], len(frame)], strict=True):
        own, chosen = features[int(frame[start])], feature[start:end]
        parts.append((own.points[chosen], own.std[chosen], own.near[chosen]))
    points, std, near = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Observed(points, std), near
