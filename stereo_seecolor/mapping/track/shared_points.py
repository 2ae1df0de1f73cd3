"""Points that several frames share: features that relative poses match, joined to one point where
they are the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stereo_seecolor.mapping.surface.surface import only_used
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.frame_blocks import Integers
from stereo_seecolor.mapping.track.image_space import Observed
from stereo_seecolor.mapping.track.relative_pose import RelativePose

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

    @property
    def views(self) -> Integers:
        """How often each point was seen: (m,)."""
        return np.bincount(self.point)


def observations(
    features: Sequence[Features], relations: Sequence[Relation], most: int
) -> TrackObservations:
    """Join the inliers of all relations to points; at most ``most`` points of each relation are
    kept, those seen most often.

    features: by position on the track. A point of which one frame shows two features is none: one
    of its matches is wrong.
    """
    frames = np.unique([ends for ends, _ in relations])
    stride = 1 + max(int(max(r.index_a.max(), r.index_b.max())) for _, r in relations)
    start = {frame: stride * k for k, frame in enumerate(frames.tolist())}
    a = np.concatenate([r.index_a + start[ends[0]] for ends, r in relations])
    b = np.concatenate([r.index_b + start[ends[1]] for ends, r in relations])
    nodes, both = only_used(np.stack([a, b]), stride * len(frames))
    a, b = both
    points, labels = connected_components(
        coo_array((np.ones(len(a), bool), (a, b)), (len(nodes), len(nodes))), directed=False
    )
    label = labels.astype(np.int64)
    views = np.bincount(label, minlength=points)
    views[_seen_twice(label, nodes // stride)] = 0
    chosen = np.zeros(points, bool)
    chosen[
        _best(
            views,
            label[a],
            np.repeat(np.arange(len(relations)), [len(r.index_a) for _, r in relations]),
            most,
        )
    ] = True
    kept = np.flatnonzero(chosen[label])
    frame, feature = frames[nodes[kept] // stride], nodes[kept] % stride
    return TrackObservations(
        frame, np.unique(label[kept], return_inverse=True)[1], *_observed(features, frame, feature)
    )


def _seen_twice(label: Integers, frame: Integers) -> Integers:
    """Labels that occur twice in a frame."""
    order = np.lexsort((frame, label))
    same = (np.diff(label[order]) == 0) & (np.diff(frame[order]) == 0)
    return np.unique(label[order][1:][same])


def _best(views: Integers, point: Integers, relation: Integers, most: int) -> Integers:
    """Points of whose observations there are at most so many: of each relation those with most
    views, equally many of each.
    """
    usable = views[point] > 0
    point, relation = point[usable], relation[usable]
    order = np.lexsort((-views[point], relation))
    point, relation = point[order], relation[order]
    place = np.arange(len(relation)) - np.searchsorted(relation, relation)
    limit = int(place.max(initial=0)) + 1
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
