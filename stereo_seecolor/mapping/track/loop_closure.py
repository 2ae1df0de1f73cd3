"""Frames that may see the same place again: by where they are thought to be, and by what they look like.

All pairs here are of positions on the track (FrameIndex.rank), smaller first.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereo_seecolor.mapping.track.features import Features

Pairs = list[tuple[int, int]]


@dataclass(frozen=True)
class LoopSettings:
    """How candidates of loops are chosen."""

    words: int = 32  # of the vocabulary: VLAD's usual 16 to 64 (Jegou et al. 2010)
    sample: int = 20_000  # descriptors that the vocabulary is made of
    neighbors: int = 5  # candidates a frame, the nearest ones that overlap
    overlap: float = 0.8  # of the sum of two frames' median radii: nearer centers see common ground
    look_alike: int = 3  # candidates a frame, by appearance
    min_apart: int = 8  # frames on the track: nearer ones look alike anyway
    max_tries: int = 1500  # pairs of frames of different components, some minutes' work


SETTINGS = LoopSettings()


def by_overlap(points_m: Iterable[tuple[int, NDArray[np.float64]]], window: int) -> Pairs:
    """Pairs more than ``window`` apart whose points overlap: the nearest few of each.

    points_m: of each frame its rank and its points (n, 3) in the world.
    """
    seen = [(rank, *_footprint(points)) for rank, points in points_m if len(points)]
    if not seen:
        return []
    ranks, centers, radii = (np.array(values) for values in zip(*seen, strict=True))
    tree, pairs = cKDTree(centers), set()
    for k, i in enumerate(ranks):
        near = np.array(sorted(tree.query_ball_point(centers[k], SETTINGS.overlap * (radii[k] + radii.max()))), np.int64)
        distance_m = np.linalg.norm(centers[near] - centers[k], axis=1)
        chosen = (distance_m < SETTINGS.overlap * (radii[near] + radii[k])) & (np.abs(ranks[near] - i) > window)
        for other in ranks[near[chosen][np.argsort(distance_m[chosen], kind="stable")][: SETTINGS.neighbors]]:
            pairs.add((int(min(i, other)), int(max(i, other))))
    return sorted(pairs)


def _footprint(points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    center = np.median(points_m, axis=0)
    return center, float(np.median(np.linalg.norm(points_m - center, axis=1)))


def between_components(components: NDArray[np.int64]) -> Pairs:
    """Pairs of different components (N,), -1 for none, thinned out evenly where there are too many to try."""
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


def by_appearance(features: Sequence[Features]) -> Pairs:
    """Pairs, far apart on the track, that look most alike. features: of each frame, in the track's order.

    VLAD descriptors (Jegou et al. 2010) with intra-normalization (Arandjelovic and Zisserman 2013).
    """
    ranks = np.array([i for i, f in enumerate(features) if len(f.descriptors)], np.int64)
    sample = _sample([features[i].descriptors for i in ranks])
    if len(ranks) < SETTINGS.min_apart or len(sample) < SETTINGS.words:
        return []
    cv2.setRNGSeed(1)
    _, _, words = cv2.kmeans(sample, SETTINGS.words, None, (cv2.TERM_CRITERIA_COUNT, 15, 0.0), 1, cv2.KMEANS_PP_CENTERS)
    vectors = np.stack([_vlad(features[i].descriptors.astype(np.float32), words) for i in ranks])
    pairs = set()
    for k, i in enumerate(ranks):
        alike = vectors @ vectors[k]
        alike[np.abs(ranks - i) < SETTINGS.min_apart] = -np.inf
        for other in np.argsort(-alike, kind="stable")[: SETTINGS.look_alike]:
            if np.isfinite(alike[other]):
                pairs.add((int(min(i, ranks[other])), int(max(i, ranks[other]))))
    return sorted(pairs)


def _sample(descriptors: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
    """Every so many of all descriptors, without a copy of them all."""
    counts = np.array([len(d) for d in descriptors], np.int64)
    step = max(1, int(counts.sum()) // SETTINGS.sample)
    starts = np.cumsum(counts) - counts
    parts = [d[-start % step :: step] for d, start in zip(descriptors, starts, strict=True)]
    return np.concatenate(parts).astype(np.float32) if parts else np.zeros((0, 128), np.float32)


def _vlad(descriptors: NDArray[np.float32], words: NDArray[np.float32]) -> NDArray[np.float32]:
    squared = (words**2).sum(1)[None] - 2 * descriptors @ words.T
    word = squared.argmin(axis=1)
    sums = np.zeros_like(words)
    np.add.at(sums, word, descriptors - words[word])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-6)
    return np.asarray(sums.ravel() / np.sqrt(len(words)))
