"""Place recognition: one vector a frame, and an inverted index of cells of vectors."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.loops import Pairs

Vectors = NDArray[np.float32]


@dataclass(frozen=True)
class RecognitionSettings:
    """How frames are described, and how many are compared."""

    words: int = 32  # of the vocabulary: VLAD's usual 16 to 64 (Jegou et al. 2010)
    sample_frames: int = 1000  # spread over the dive, which the vocabulary and the axes are made of
    sample: int = 20_000  # descriptors that the vocabulary is made of
    # principal ones that a vector is reduced to (Jegou and Chum 2012); by 128, half of simulated
    # places are found
    axes: int = 512
    cell: int = 1000  # vectors in a cell: an inverted file (Jegou, Douze and Schmid 2011)
    cells: int = 8  # cells that a frame is compared with, however long the dive
    look_alike: int = 3  # candidates a frame
    min_apart: int = 8  # frames on the track: nearer ones look alike anyway


SETTINGS = RecognitionSettings()


@dataclass(frozen=True, eq=False)
class Description:
    """Describes the frame at a position on the track by a vector (k,).

    VLAD (Jegou et al. 2010) with intra-normalization (Arandjelovic and Zisserman 2013), on its
    principal axes where these are known. words: (w, 128). mean: (w * 128,). axes: (w * 128, k),
    None for all numbers as they are.
    """

    features: Sequence[Features]
    words: Vectors
    mean: Vectors | None = None
    axes: Vectors | None = None

    def __call__(self, position: int) -> Vectors:
        """Empty where the frame shows nothing."""
        descriptors = self.features[position].descriptors.astype(np.float32)
        if not len(descriptors):
            return np.zeros(0, np.float32)
        word = ((self.words**2).sum(1)[None] - 2 * descriptors @ self.words.T).argmin(axis=1)
        belongs = (word == np.arange(len(self.words))[:, None]).astype(np.float32)
        sums = belongs @ descriptors - belongs.sum(axis=1, keepdims=True) * self.words
        sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-6)
        vector = np.asarray(sums.ravel() / np.sqrt(len(self.words)), np.float32)
        return (
            vector
            if self.axes is None or self.mean is None
            else np.asarray((vector - self.mean) @ self.axes, np.float32)
        )


def by_appearance(features: Sequence[Features], compute: Compute) -> Pairs:
    """Pairs of positions, far apart on the track, that look most alike, smaller first.

    features: of each frame, in the track's order. Each is compared with some thousands of others,
    however long the dive; memory grows by 2 KB for each.
    """
    chosen = range(0, len(features), max(1, -(-len(features) // SETTINGS.sample_frames)))
    sample = _sample([features[i].descriptors for i in chosen])
    if len(sample) < SETTINGS.words:
        return []
    cv2.setRNGSeed(1)
    _, _, words = cv2.kmeans(
        sample,
        SETTINGS.words,
        None,
        (cv2.TERM_CRITERIA_COUNT, 15, 0.0),
        1,
        cv2.KMEANS_PP_CENTERS,
    )
    described = list(
        compute.each(_reduced(Description(features, words), chosen), range(len(features)))
    )
    seen = [position for position, vector in enumerate(described) if len(vector)]
    near = _compared(np.stack([described[position] for position in seen]), np.array(seen, np.int64))
    pairs = zip(np.repeat(seen, near.shape[1]).tolist(), near.ravel().tolist(), strict=True)
    return sorted({(min(pair), max(pair)) for pair in pairs if pair[1] >= 0})


def _reduced(describe: Description, chosen: Sequence[int]) -> Description:
    """The same on the principal axes of the chosen frames."""
    known = np.stack([vector for i in chosen if len(vector := describe(i))])
    mean = known.mean(axis=0)
    off = known - mean
    # far smaller than the covariance of 4096 numbers
    strengths, mixes = np.linalg.eigh(off @ off.T)
    axes = off.T @ mixes[:, ::-1][:, : SETTINGS.axes][:, strengths[::-1][: SETTINGS.axes] > 0]
    axes /= np.maximum(np.linalg.norm(axes, axis=0), 1e-6)
    return Description(describe.features, describe.words, mean, np.ascontiguousarray(axes))


def _compared(vectors: Vectors, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, look_alike) ranks of the nearest, -1 for none: each vector against those of the cells
    nearest to it.
    """
    count = -(-len(vectors) // SETTINGS.cell)
    step = max(1, len(vectors) // (count * 20))
    cv2.setRNGSeed(1)
    _, _, centers = cv2.kmeans(
        vectors[::step], count, None, (cv2.TERM_CRITERIA_COUNT, 10, 0.0), 1, cv2.KMEANS_PP_CENTERS
    )
    order = ((centers**2).sum(1) - 2 * vectors @ centers.T).argsort(axis=1, kind="stable")[
        :, : SETTINGS.cells
    ]
    wanted = SETTINGS.look_alike
    least = np.full((len(vectors), wanted), np.inf, np.float32)
    near = np.full((len(vectors), wanted), -1, np.int64)
    for cell in range(count):
        members = np.flatnonzero(order[:, 0] == cell)
        asking = np.flatnonzero((order == cell).any(axis=1))
        if not len(members):
            continue
        for part in np.array_split(asking, -(-len(asking) // SETTINGS.cell)):
            squared = (vectors[members] ** 2).sum(1) - 2 * vectors[part] @ vectors[members].T
            squared[np.abs(ranks[part][:, None] - ranks[members]) < SETTINGS.min_apart] = np.inf
            both = np.concatenate([least[part], squared], axis=1)
            names = np.concatenate(
                [near[part], np.broadcast_to(ranks[members], squared.shape)], axis=1
            )
            best = both.argpartition(wanted - 1, axis=1)[:, :wanted]
            least[part] = np.take_along_axis(both, best, 1)
            near[part] = np.take_along_axis(names, best, 1)
    return np.where(np.isfinite(least), near, -1)


def _sample(descriptors: Sequence[NDArray[np.uint8]]) -> Vectors:
    """As many of each frame's descriptors as make enough."""
    each = max(1, -(-SETTINGS.sample // max(1, len(descriptors))))
    parts = [found[:: max(1, -(-len(found) // each))] for found in descriptors]
    return np.concatenate(parts).astype(np.float32) if parts else np.zeros((0, 128), np.float32)
