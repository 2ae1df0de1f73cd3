"""Sparse linear equations in blocks of six unknowns, the pose of one frame each; a block is coupled
with few others.

Reverse Cuthill-McKee (George and Liu 1981) puts coupled blocks near each other. Then parts of as
many blocks as the bandwidth are coupled with the parts beside them alone: a block tridiagonal
matrix, solved by Cholesky's method part by part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.sparse import bsr_array, coo_array, csr_array
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.relative_pose import Observed, RelativePose

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SIDE = 6
"""Of a block."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The order of the blocks. place: (N,) where each block comes. size: blocks in a part."""

    place: Integers
    size: int

    @classmethod
    def of(cls, joined: csr_array) -> "Layout":
        """Order blocks so that coupled ones are close. joined: (N, N), symmetric, which blocks are
        coupled.
        """
        place = np.empty(joined.shape[0], np.int64)
        place[reverse_cuthill_mckee(joined, symmetric_mode=True)] = np.arange(len(place))
        row, column = joined.nonzero()
        reach = max(1, int(np.abs(place[row] - place[column]).max(initial=0)))
        return cls(place, reach if 2 * reach < len(place) else len(place))

    def zeros(self) -> "FrameBlocks":
        """Equations to be filled."""
        parts, width = -(-len(self.place) // self.size), SIDE * self.size
        blocks = FrameBlocks(
            self,
            np.zeros((parts, width, width)),
            np.zeros((parts - 1, width, width)),
            np.zeros(parts * width),
        )
        unused = np.arange(SIDE * len(self.place), parts * width)
        blocks.diagonal[unused // width, unused % width, unused % width] = 1
        return blocks


@dataclass(frozen=True, eq=False)
class FrameBlocks:
    """A block tridiagonal system. diagonal: (K, w, w), of which the lower triangles count, below:
    (K - 1, w, w). g: (K w,) right side.
    """

    layout: Layout
    diagonal: Array
    below: Array
    g: Array

    def add(self, first: int, second: int, H: Array) -> None:
        """Add H (6, 6), rows of the first block, columns of the second; of two blocks that differ
        also its transpose.
        """
        size, row, column = (
            self.layout.size,
            int(self.layout.place[first]),
            int(self.layout.place[second]),
        )
        if row < column:
            row, column, H = column, row, H.T
        part = (
            self.diagonal[row // size]
            if row // size == column // size
            else self.below[column // size]
        )
        i, j = SIDE * (row % size), SIDE * (column % size)
        part[i : i + SIDE, j : j + SIDE] += H

    def add_right(self, block: int, g: Array) -> None:
        """Add g (6,)."""
        at = SIDE * int(self.layout.place[block])
        self.g[at : at + SIDE] += g

    def subtract(self, coupled: bsr_array, g: Array) -> None:
        """Subtract blocks (6, 6) of a symmetric matrix, and of the right side, both in the order of
        the places.
        """
        size = self.layout.size
        row = np.repeat(np.arange(len(coupled.indptr) - 1), np.diff(coupled.indptr))
        column = coupled.indices
        within = (column <= row) & (row // size == column // size)
        across = (column <= row) & (row // size != column // size)
        for parts, chosen in ((self.diagonal, within), (self.below, across)):
            blocks = parts.reshape(-1, size, SIDE, size, SIDE)
            i, j = row[chosen], column[chosen]
            blocks[j // size, i % size, :, j % size] -= coupled.data[chosen]
        self.g[: len(g)] -= g

    def solve(self) -> Array:
        """Solve the system: (N, 6). Raises LinAlgError where it is singular."""
        left = self.g.reshape(len(self.diagonal), -1).copy()
        for k, (L, coupling) in enumerate(self._factors):
            left[k] = solve_triangular(L, left[k], lower=True)
            if coupling is not None:
                left[k + 1] -= coupling @ left[k]
        for k, (L, coupling) in reversed(list(enumerate(self._factors))):
            if coupling is not None:
                left[k] -= coupling.T @ left[k + 1]
            left[k] = solve_triangular(L, left[k], lower=True, trans="T")
        return np.asarray(left.reshape(-1, SIDE)[self.layout.place])

    def covariances(self) -> Array:
        """Compute the blocks on the diagonal of the inverse: (N, 6, 6). Raises LinAlgError."""
        size, after, found = self.layout.size, None, []
        for L, coupling in reversed(self._factors):
            own = cho_solve((L, True), np.eye(len(L)))
            if after is not None and coupling is not None:
                by_next = solve_triangular(L, coupling.T, lower=True, trans="T")
                own += by_next @ after @ by_next.T
            found.append(
                np.stack([own[i : i + SIDE, i : i + SIDE] for i in range(0, SIDE * size, SIDE)])
            )
            after = own
        return np.asarray(np.concatenate(found[::-1])[self.layout.place])

    @cached_property
    def _factors(self) -> list[tuple[Array, Array | None]]:
        """Of each part its Cholesky factor, and that of the part below it, None for the last."""
        factors: list[tuple[Array, Array | None]] = []
        for k, own in enumerate(self.diagonal):
            coupling = factors[-1][1] if k else None
            if coupling is not None:
                own = own - coupling @ coupling.T
            L = cholesky(own, lower=True, check_finite=False)
            more = k < len(self.below)
            factors.append(
                (
                    L,
                    solve_triangular(L, self.below[k].T, lower=True, check_finite=False).T
                    if more
                    else None,
                )
            )
        return factors


# Points that several frames share: features that relative poses match, joined to one point where
# they are the same.

Relation = tuple[tuple[int, int], RelativePose]
"""Two positions on the track, and their relative pose."""


@dataclass(frozen=True, eq=False)
class TrackObservations:
    """n observations of m points. frame: (n,) position on the track, point: (n,) number from 0 to m
    - 1, seen: (n,) as it was seen.
    """

    frame: Integers
    point: Integers
    seen: Observed

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
    stride = 1 + max(int(max(r.index_a.max(), r.index_b.max())) for _, r in relations)
    a = np.concatenate([ends[0] * stride + r.index_a for ends, r in relations])
    b = np.concatenate([ends[1] * stride + r.index_b for ends, r in relations])
    nodes, ends = np.unique(np.concatenate([a, b]), return_inverse=True)
    a, b = ends[: len(a)], ends[len(a) :]
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
    frame, feature = nodes[kept] // stride, nodes[kept] % stride
    return TrackObservations(
        frame, np.unique(label[kept], return_inverse=True)[1], _observed(features, frame, feature)
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


def _observed(features: Sequence[Features], frame: Integers, feature: Integers) -> Observed:
    """Frames ascend: each is read once."""
    starts = np.flatnonzero(np.diff(frame, prepend=-1))
    parts = []
    for start, end in zip(starts, [*starts[1:], len(frame)], strict=True):
        own, chosen = features[int(frame[start])], feature[start:end]
        parts.append((own.points[chosen], own.std[chosen]))
    points, std = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Observed(points, std)
