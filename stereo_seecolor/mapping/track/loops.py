"""Candidates for loop closure by the estimated positions of frames, and the check of loops; by
appearance: ``place_recognition``.

All pairs here are of positions on the track (FrameIndex.rank), smaller first.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.transforms import inverse, transform_points
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.relative_pose import Edge

Pairs = list[tuple[int, int]]


@dataclass(frozen=True)
class LoopSettings:
    """How candidates of loops are chosen."""

    neighbors: int = 5  # candidates a frame, the nearest ones that overlap
    overlap: float = 0.8  # of the sum of two frames' median radii: nearer centers see common ground
    max_tries: int = 1500  # pairs of frames of different components, some minutes' work
    # of the path: the most that a track may drift, several times what it does (docs/mapping.md)
    drift_fraction: float = 0.05
    drift_m: float = 0.5  # and so many meters, for short paths


SETTINGS = LoopSettings()


def by_overlap(points_m: Iterable[tuple[int, NDArray[np.float64]]], window: int) -> Pairs:
    """Find pairs of frames more than ``window`` apart whose points overlap: the nearest few of each
    frame.

    points_m: of each frame its rank and its points (n, 3) in the world.
    """
    seen = [(rank, *_footprint(points)) for rank, points in points_m if len(points)]
    if not seen:
        return []
    ranks, centers, radii = (np.array(values) for values in zip(*seen, strict=True))
    tree, pairs = cKDTree(centers), set()
    for k, i in enumerate(ranks):
        near = np.array(
            sorted(tree.query_ball_point(centers[k], SETTINGS.overlap * (radii[k] + radii.max()))),
            np.int64,
        )
        distance_m = np.linalg.norm(centers[near] - centers[k], axis=1)
        chosen = (distance_m < SETTINGS.overlap * (radii[near] + radii[k])) & (
            np.abs(ranks[near] - i) > window
        )
        for other in ranks[
            near[chosen][np.argsort(distance_m[chosen], kind="stable")][: SETTINGS.neighbors]
        ]:
            pairs.add((int(min(i, other)), int(max(i, other))))
    return sorted(pairs)


def _footprint(points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    center = np.median(points_m, axis=0)
    return center, float(np.median(np.linalg.norm(points_m - center, axis=1)))


def between_components(components: NDArray[np.int64]) -> Pairs:
    """Pairs of frames of different components (N,), -1 for none, thinned out evenly."""
    placed = np.flatnonzero(components >= 0)
    labels = components[placed]
    own = np.zeros(len(placed), np.int64)
    for label in np.unique(labels):
        own[labels == label] = np.arange(np.count_nonzero(labels == label))[::-1]
    partners = np.arange(len(placed))[::-1] - own  # later frames of other components
    ends = np.cumsum(partners)
    total = int(ends[-1]) if len(ends) else 0
    step = max(1, -(-total // SETTINGS.max_tries))
    pairs = []
    for number in range(0, total, step):
        k = int(np.searchsorted(ends, number, side="right"))
        others = np.flatnonzero(labels[k + 1 :] != labels[k]) + k + 1
        pairs.append((int(placed[k]), int(placed[others[number - (ends[k] - partners[k])]])))
    return pairs


def lengths_m(T_world_camera: NDArray[np.float64], order: NDArray[np.int64]) -> NDArray[np.float64]:
    """Length of the track up to each position: (N,) meters. order: (N,) frames by position."""
    centers = T_world_camera[order, :3, 3]
    placed = np.isfinite(centers).all(axis=1)
    steps = np.zeros(len(centers))
    steps[np.flatnonzero(placed)[1:]] = np.linalg.norm(np.diff(centers[placed], axis=0), axis=1)
    return np.cumsum(steps)


def is_plausible(
    loop: Edge, T_world_camera: NDArray[np.float64], ends_m: NDArray[np.float64]
) -> bool:
    """Whether a loop contradicts the track by no more than it can drift between its ends.

    ends_m: (2,) length of the track at both ends.
    """
    expected = inverse(T_world_camera[loop.i]) @ T_world_camera[loop.j]
    return float(np.linalg.norm(expected[:3, 3] - loop.T_i_j[:3, 3])) < _drift_m(ends_m)


def possible(
    pairs: Pairs,
    index: FrameIndex,
    T_world_camera: NDArray[np.float64],
    components: NDArray[np.int64],
) -> Pairs:
    """Leave out pairs of one component whose frames do not overlap, as far as the track may have
    drifted between them.
    """
    ends_m = lengths_m(T_world_camera, index.order)

    def may_overlap(first: int, second: int) -> bool:
        i, j = index.order[[first, second]]
        if (
            components[i] < 0
            or components[i] != components[j]
            or not len(index.points_m[i])
            or not len(index.points_m[j])
        ):
            return True
        (a, a_m), (b, b_m) = (
            _footprint(transform_points(T_world_camera[k], index.points_m[k])) for k in (i, j)
        )
        return float(np.linalg.norm(a - b)) < SETTINGS.overlap * (a_m + b_m) + _drift_m(
            ends_m[[first, second]]
        )

    return [pair for pair in pairs if may_overlap(*pair)]


def _drift_m(ends_m: NDArray[np.float64]) -> float:
    return SETTINGS.drift_m + SETTINGS.drift_fraction * abs(float(ends_m[1] - ends_m[0]))
