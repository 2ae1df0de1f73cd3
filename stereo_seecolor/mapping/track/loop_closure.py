"""Frames that may see the same place again: by where they are thought to be, and by what they look like."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.features import Features

WORDS = 32
SAMPLE = 20_000
NEIGHBORS = 5
LOOK_ALIKE = 3
MIN_APART = 8
MAX_TRIES = 1500


def by_overlap(index: FrameIndex, T_world_camera: NDArray[np.float64], frames: list[int], window: int) -> list[tuple[int, int]]:
    """Pairs (i < j) more than ``window`` apart whose sights overlap by their present poses: the five nearest of each."""
    seen = [i for i in frames if len(index.points_m[i])]
    points = {i: index.points_m[i] @ T_world_camera[i, :3, :3].T + T_world_camera[i, :3, 3] for i in seen}
    centers = np.array([np.median(points[i], axis=0) for i in seen]).reshape(-1, 3)
    radii = np.array([np.median(np.linalg.norm(points[i] - c, axis=1)) for i, c in zip(seen, centers, strict=True)])
    numbers = np.array(seen)
    pairs = set()
    for k, i in enumerate(seen):
        distance = np.linalg.norm(centers - centers[k], axis=1)
        near = np.flatnonzero((distance < 0.8 * (radii + radii[k])) & (np.abs(numbers - i) > window))
        for other in near[np.argsort(distance[near], kind="stable")][:NEIGHBORS]:
            pairs.add((min(i, seen[other]), max(i, seen[other])))
    return sorted(pairs)


def between_pieces(pieces: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Pairs (i < j) of frames of different pieces, thinned out evenly where there are too many to try."""
    placed = np.flatnonzero(pieces >= 0)
    i, j = (placed[k] for k in np.triu_indices(len(placed), 1))
    apart = pieces[i] != pieces[j]
    i, j = i[apart], j[apart]
    step = max(1, -(-len(i) // MAX_TRIES))
    return [(int(a), int(b)) for a, b in zip(i[::step], j[::step], strict=True)]


def by_appearance(features: dict[int, Features]) -> list[tuple[int, int]]:
    """Pairs (i < j), far apart in the track, that look most alike.

    VLAD descriptors (Jegou et al. 2010) with intra-normalization (Arandjelovic and Zisserman 2013).
    """
    frames = [i for i, f in features.items() if len(f.descriptors)]
    if len(frames) < MIN_APART:
        return []
    everything = np.concatenate([features[i].descriptors for i in frames])
    sample = everything[:: max(1, len(everything) // SAMPLE)].astype(np.float32)
    if len(sample) < WORDS:
        return []
    cv2.setRNGSeed(1)
    _, _, words = cv2.kmeans(sample, WORDS, None, (cv2.TERM_CRITERIA_COUNT, 15, 0.0), 1, cv2.KMEANS_PP_CENTERS)
    vectors = np.stack([_vlad(features[i].descriptors.astype(np.float32), words) for i in frames])
    numbers, pairs = np.array(frames), set()
    for k, i in enumerate(frames):
        alike = vectors @ vectors[k]
        alike[np.abs(numbers - i) < MIN_APART] = -np.inf
        for other in np.argsort(-alike, kind="stable")[:LOOK_ALIKE]:
            if np.isfinite(alike[other]):
                pairs.add((min(i, frames[other]), max(i, frames[other])))
    return sorted(pairs)


def _vlad(descriptors: NDArray[np.float32], words: NDArray[np.float32]) -> NDArray[np.float32]:
    squared = (words**2).sum(1)[None] - 2 * descriptors @ words.T
    word = squared.argmin(axis=1)
    sums = np.zeros_like(words)
    np.add.at(sums, word, descriptors - words[word])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-6)
    return np.asarray(sums.ravel() / np.sqrt(len(words)))
