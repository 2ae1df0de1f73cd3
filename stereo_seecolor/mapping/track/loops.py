"""Loops: candidates by place and by appearance, their check, and the pose graph that they close."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.errors import DeviceError
from stereo_seecolor.geometry import inverse, transformed
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.relative_pose import Edge

# Candidates for loop closure by the estimated positions of frames, and the check of loops; by
# appearance: ``place_recognition``.
#
# All pairs here are of positions on the track (FrameIndex.rank), smaller first.

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


LOOP_SETTINGS = LoopSettings()


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
            sorted(
                tree.query_ball_point(centers[k], LOOP_SETTINGS.overlap * (radii[k] + radii.max()))
            ),
            np.int64,
        )
        distance_m = np.linalg.norm(centers[near] - centers[k], axis=1)
        chosen = (distance_m < LOOP_SETTINGS.overlap * (radii[near] + radii[k])) & (
            np.abs(ranks[near] - i) > window
        )
        for other in ranks[
            near[chosen][np.argsort(distance_m[chosen], kind="stable")][: LOOP_SETTINGS.neighbors]
        ]:
            pairs.add((int(min(i, other)), int(max(i, other))))
    return sorted(pairs)


def _footprint(points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    center = np.median(points_m, axis=0)
    return center, float(np.median(np.linalg.norm(points_m - center, axis=1)))


def between_components(components: NDArray[np.int64]) -> Pairs:
    """List pairs of frames of different components (N,), -1 for none, thinned out evenly where
    there are too many to try.
    """
    placed = np.flatnonzero(components >= 0)
    labels = components[placed]
    own = np.zeros(len(placed), np.int64)
    for label in np.unique(labels):
        own[labels == label] = np.arange(np.count_nonzero(labels == label))[::-1]
    partners = np.arange(len(placed))[::-1] - own  # later frames of other components
    ends = np.cumsum(partners)
    total = int(ends[-1]) if len(ends) else 0
    step = max(1, -(-total // LOOP_SETTINGS.max_tries))
    pairs = []
    for number in range(0, total, step):
        k = int(np.searchsorted(ends, number, side="right"))
        others = np.flatnonzero(labels[k + 1 :] != labels[k]) + k + 1
        pairs.append((int(placed[k]), int(placed[others[number - (ends[k] - partners[k])]])))
    return pairs


def lengths_m(T_world_camera: NDArray[np.float64], order: NDArray[np.int64]) -> NDArray[np.float64]:
    """Compute the length of the track up to each of its positions: (N,) meters. order: (N,) the
    frame at each position.
    """
    centers = T_world_camera[order, :3, 3]
    placed = np.isfinite(centers).all(axis=1)
    steps = np.zeros(len(centers))
    steps[np.flatnonzero(placed)[1:]] = np.linalg.norm(np.diff(centers[placed], axis=0), axis=1)
    return np.cumsum(steps)


def is_plausible(
    loop: Edge, T_world_camera: NDArray[np.float64], ends_m: NDArray[np.float64]
) -> bool:
    """Tell whether a loop contradicts the track by no more than the track can drift between its
    ends.

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
            _footprint(transformed(T_world_camera[k], index.points_m[k])) for k in (i, j)
        )
        return float(np.linalg.norm(a - b)) < LOOP_SETTINGS.overlap * (a_m + b_m) + _drift_m(
            ends_m[[first, second]]
        )

    return [pair for pair in pairs if may_overlap(*pair)]


def _drift_m(ends_m: NDArray[np.float64]) -> float:
    return LOOP_SETTINGS.drift_m + LOOP_SETTINGS.drift_fraction * abs(float(ends_m[1] - ends_m[0]))


# Place recognition: frames that look alike, found by one vector for each frame and an inverted
# index of cells of vectors.

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


RECOGNITION_SETTINGS = RecognitionSettings()


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
    chosen = range(
        0, len(features), max(1, -(-len(features) // RECOGNITION_SETTINGS.sample_frames))
    )
    sample = _sample([features[i].descriptors for i in chosen])
    if len(sample) < RECOGNITION_SETTINGS.words:
        return []
    cv2.setRNGSeed(1)
    _, _, words = cv2.kmeans(
        sample,
        RECOGNITION_SETTINGS.words,
        None,
        (cv2.TERM_CRITERIA_COUNT, 15, 0.0),
        1,
        cv2.KMEANS_PP_CENTERS,
    )
    described = list(
        compute.each(_reduced(Description(features, words), chosen), range(len(features)))
    )
    seen = [position for position, vector in enumerate(described) if len(vector)]
    return _nearest(np.stack([described[position] for position in seen]), np.array(seen, np.int64))


def _reduced(describe: Description, chosen: Sequence[int]) -> Description:
    """The same on the principal axes of the chosen frames."""
    known = np.stack([vector for i in chosen if len(vector := describe(i))])
    mean = known.mean(axis=0)
    off = known - mean
    # far smaller than the covariance of 4096 numbers
    strengths, mixes = np.linalg.eigh(off @ off.T)
    axes = (
        off.T
        @ mixes[:, ::-1][:, : RECOGNITION_SETTINGS.axes][
            :, strengths[::-1][: RECOGNITION_SETTINGS.axes] > 0
        ]
    )
    axes /= np.maximum(np.linalg.norm(axes, axis=0), 1e-6)
    return Description(describe.features, describe.words, mean, np.ascontiguousarray(axes))


def _nearest(vectors: Vectors, ranks: NDArray[np.int64]) -> Pairs:
    """The few nearest of each that are not its neighbors on the track."""
    near = _compared(vectors, ranks)
    pairs = set()
    for rank, found in zip(ranks.tolist(), near, strict=True):
        pairs |= {(min(rank, int(other)), max(rank, int(other))) for other in found if other >= 0}
    return sorted(pairs)


def _compared(vectors: Vectors, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, look_alike) ranks of the nearest, -1 for none: each vector against those of the cells
    nearest to it.
    """
    count = -(-len(vectors) // RECOGNITION_SETTINGS.cell)
    step = max(1, len(vectors) // (count * 20))
    cv2.setRNGSeed(1)
    _, _, centers = cv2.kmeans(
        vectors[::step], count, None, (cv2.TERM_CRITERIA_COUNT, 10, 0.0), 1, cv2.KMEANS_PP_CENTERS
    )
    order = ((centers**2).sum(1) - 2 * vectors @ centers.T).argsort(axis=1, kind="stable")[
        :, : RECOGNITION_SETTINGS.cells
    ]
    wanted = RECOGNITION_SETTINGS.look_alike
    least = np.full((len(vectors), wanted), np.inf, np.float32)
    near = np.full((len(vectors), wanted), -1, np.int64)
    for cell in range(count):
        members, asking = (
            np.flatnonzero(order[:, 0] == cell),
            np.flatnonzero((order == cell).any(axis=1)),
        )
        for part in (
            np.array_split(asking, -(-len(asking) // RECOGNITION_SETTINGS.cell))
            if len(members)
            else ()
        ):
            squared = (vectors[members] ** 2).sum(1) - 2 * vectors[part] @ vectors[members].T
            squared[
                np.abs(ranks[part][:, None] - ranks[members]) < RECOGNITION_SETTINGS.min_apart
            ] = np.inf
            both = np.concatenate([least[part], squared], axis=1)
            names = np.concatenate(
                [near[part], np.broadcast_to(ranks[members], squared.shape)], axis=1
            )
            best = (
                both.argpartition(wanted - 1, axis=1)[:, :wanted]
                if both.shape[1] > wanted
                else np.arange(both.shape[1])[None]
            )
            best = np.broadcast_to(best, (len(part), best.shape[1]))
            least[part], near[part] = (
                np.take_along_axis(both, best, 1),
                np.take_along_axis(names, best, 1),
            )
    return np.where(np.isfinite(least), near, -1)


def _sample(descriptors: Sequence[NDArray[np.uint8]]) -> Vectors:
    """As many of each frame's descriptors as make enough."""
    each = max(1, -(-RECOGNITION_SETTINGS.sample // max(1, len(descriptors))))
    parts = [found[:: max(1, -(-len(found) // each))] for found in descriptors]
    return np.concatenate(parts).astype(np.float32) if parts else np.zeros((0, 128), np.float32)


# The pose graph of all relative poses, optimized by GTSAM's sparse solver with a kernel against
# false loops.

REJECT_SIGMAS = 6.0
"""An edge of a loop further off than this is false."""
CAUCHY = 3.0
"""Scale of the Cauchy kernel, in sigmas: edges within three of them keep most of their weight."""
WIDER, DRIFTED = (1000.0, 100.0, 10.0), 10.0
"""Scales before that one, from ten times what loops are usually off at the start, where that is
more than so many sigmas: a narrow kernel leaves out what closes a long dive's drift of meters as it
does what is false.
"""
UNKNOWN = 1e4
"""Standard error of what a prior does not say, meters."""


@dataclass(frozen=True, eq=False)
class Prior:
    """The pose that navigation gives a frame: T_world_camera (4, 4), and its standard errors;
    position_std_m: (3,) in world axes.
    """

    frame: int
    T_world_camera: NDArray[np.float64]
    position_std_m: NDArray[np.float64]
    attitude_std_rad: float


def available() -> bool:
    """Tell whether GTSAM can be imported."""
    try:
        gtsam_library()
    except DeviceError:
        return False
    return True


def solve(
    T_world_camera: NDArray[np.float64],
    frames: Sequence[int],
    edges: Sequence[Edge],
    priors: Sequence[Prior] = (),
) -> tuple[NDArray[np.float64], list[Edge]]:
    """Poses that agree best with edges and priors, and the edges that do not fit the rest: false
    loops.

    T_world_camera: (N, 4, 4) first guess; only ``frames`` are solved for, and the edges must
    connect them all; the first stays put where there are no priors. Levenberg-Marquardt under a
    Cauchy kernel, which false loops hardly bend, and which is narrowed step by step where the first
    guess has drifted; a loop beyond six sigmas is false.

    Raises DeviceError if GTSAM is missing.
    """
    gtsam = gtsam_library()
    solved, off = (
        T_world_camera,
        [_sigmas(gtsam, T_world_camera, edge) for edge in edges if edge.loop],
    )
    usual = float(np.median(off)) if off else 0.0
    wider = [scale for scale in WIDER if scale < 10 * usual] if usual > DRIFTED else []
    for scale in (*wider, CAUCHY):
        solved = _optimize(gtsam, solved, frames, edges, priors, scale)
    return solved, [
        edge for edge in edges if edge.loop and _sigmas(gtsam, solved, edge) > REJECT_SIGMAS
    ]


def gtsam_library() -> Any:
    """GTSAM. Raises DeviceError if it is missing."""
    try:
        import gtsam
    except (ImportError, OSError) as error:
        what = "loop closure and navigation as a prior need GTSAM, which is missing"
        raise DeviceError(f"{what} ({error}): pip install 'stereo-seecolor[slam]'") from error
    return gtsam


def _optimize(
    gtsam: Any,
    T: NDArray[np.float64],
    frames: Sequence[int],
    edges: Sequence[Edge],
    priors: Sequence[Prior],
    scale: float,
) -> NDArray[np.float64]:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(scale)
    for frame in frames:
        values.insert(int(frame), gtsam.Pose3(T[frame]))
    noise = gtsam.noiseModel
    for edge in edges:
        gaussian = noise.Gaussian.Covariance(edge.covariance)
        robust = noise.Robust.Create(kernel, gaussian)
        graph.add(gtsam.BetweenFactorPose3(edge.i, edge.j, gtsam.Pose3(edge.T_i_j), robust))
    _add_priors(gtsam, graph, int(frames[0]), T, priors)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    solved = T.copy()
    for frame in frames:
        solved[frame] = result.atPose3(int(frame)).matrix()
    return solved


def _add_priors(
    gtsam: Any, graph: Any, first: int, T: NDArray[np.float64], priors: Sequence[Prior]
) -> None:
    """What is known of the frames; without any, the first one stays where it is. T: (N, 4, 4) as
    they are now.
    """
    noise = gtsam.noiseModel
    for prior in priors:
        pose = gtsam.Pose3(prior.T_world_camera)
        graph.add(
            gtsam.GPSFactor(
                prior.frame, pose.translation(), noise.Diagonal.Sigmas(prior.position_std_m)
            )
        )
        attitude = np.array([prior.attitude_std_rad] * 3 + [UNKNOWN] * 3)
        graph.add(gtsam.PriorFactorPose3(prior.frame, pose, noise.Diagonal.Sigmas(attitude)))
    if not priors:
        graph.add(
            gtsam.PriorFactorPose3(first, gtsam.Pose3(T[first]), noise.Isotropic.Sigma(6, 1e-6))
        )


def _sigmas(gtsam: Any, T: NDArray[np.float64], edge: Edge) -> float:
    """How far an edge is from the solution, in its own standard deviations."""
    between = gtsam.Pose3(T[edge.i]).between(gtsam.Pose3(T[edge.j]))
    off = gtsam.Pose3(edge.T_i_j).localCoordinates(between)
    return float(np.sqrt(off @ np.linalg.solve(edge.covariance, off)))
