"""Connected components of frames by relative-pose edges, with a first estimate of their poses."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.geometry import inverse, rotation_vector
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.track.relative_pose import Edge

Array = NDArray[np.float64]

MIN_FRAMES = 2
"""A frame that matches no other has no place."""
JOIN_EDGES = 2
"""Edges that must agree before two components are joined: one may be false."""
JOIN_M, JOIN_RAD = 0.3, 0.1
"""How well they must agree, meters and radians: several times the error of an edge, far below a
false one's.
"""


def chain(edges: Sequence[Edge], rank: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Chain poses along the strongest edges: (N, 4, 4) and (N,) components; the largest is 0,
    frames without edges are -1 and NaN.

    Each component starts at the identity, in its first frame by ``rank`` (N,).
    """
    # a fifth of a second, which ``run`` need not wait for: it chains nothing
    from scipy.sparse import (
        csr_array,
    )
    from scipy.sparse.csgraph import (
        breadth_first_order,
        connected_components,
        minimum_spanning_tree,
    )

    count = len(rank)
    T, components = np.full((count, 4, 4), np.nan), np.full(count, -1)
    order = sorted(range(len(edges)), key=lambda k: -edges[k].inliers)
    weights = np.empty(len(edges))
    weights[order] = np.arange(1, len(edges) + 1)
    ends = [edge.i for edge in edges], [edge.j for edge in edges]
    tree = minimum_spanning_tree(csr_array((weights, ends), (count, count)))
    labels = connected_components(tree, directed=False)[1]
    steps = {(e.i, e.j): e.T_i_j for e in edges} | {(e.j, e.i): inverse(e.T_i_j) for e in edges}
    groups = sorted(
        (np.flatnonzero(labels == label) for label in np.unique(labels)),
        key=lambda g: (-len(g), rank[g].min()),
    )
    for number, group in enumerate(g for g in groups if len(g) >= MIN_FRAMES):
        components[group] = number
        start = group[rank[group].argmin()]
        T[start] = np.eye(4)
        reached, before = breadth_first_order(tree, start, directed=False)
        for j in reached[1:]:
            T[j] = T[before[j]] @ steps[before[j], j]
    return T, components


def agreeing(edges: Sequence[Edge], T: Array, components: NDArray[np.int64]) -> list[Edge]:
    """Edges that join two components count only if at least two of them put the components to the
    same place.
    """

    def joint(edge: Edge) -> Array:
        return np.asarray(T[edge.i] @ edge.T_i_j @ inverse(T[edge.j]))

    def agree(a: Edge, b: Edge) -> bool:
        first, second = (
            joint(a),
            joint(b) if components[a.i] == components[b.i] else inverse(joint(b)),
        )
        at_a, at_b = first @ T[a.j], second @ T[a.j]
        turn = np.linalg.norm(rotation_vector(first[:3, :3].T @ second[:3, :3]))
        return float(np.linalg.norm(at_a[:3, 3] - at_b[:3, 3])) < JOIN_M and float(turn) < JOIN_RAD

    between = defaultdict(list)
    for edge in edges:
        between[frozenset(components[[edge.i, edge.j]].tolist())].append(edge)
    return [
        edge
        for joining in between.values()
        for edge in joining
        if sum(agree(edge, other) for other in joining) >= JOIN_EDGES
    ]


# Single poses that jump away and back, and jumps that stay: there a track breaks into components.

MIN_JUMP_M = 2.0
"""Less is not a jump, whatever the speed: positions of vehicles are not better."""
MAX_SPEED_M_S, JUMP_SPEEDS = 3.0, 3.0
"""Speed, m/s, and multiple of the usual speed that a step must both exceed to be a jump."""
JUMP_STEPS = 10.0
"""Usual steps between frames that a step must exceed to be a jump, where times do not tell the
speed.
"""


def drop_spikes(T: NDArray[np.float64], index: FrameIndex, reasons: dict[int, str]) -> None:
    """Take out single poses that jump away and back."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed)
    for before, spike, after in zip(placed, placed[1:], placed[2:], strict=False):
        away = _distance_m(T, before, spike) > limit(before, spike) and _distance_m(
            T, spike, after
        ) > limit(spike, after)
        if (
            away
            and _distance_m(T, before, after) <= limit(before, after)
            and np.isfinite(T[before]).all()
        ):
            reasons[spike] = f"its pose jumps {_distance_m(T, before, spike):.1f} m away and back"
            T[spike] = np.nan


def break_up(T: NDArray[np.float64], index: FrameIndex) -> tuple[NDArray[np.int64], list[str]]:
    """Number the segments between jumps; the one with most frames is component 0."""
    placed = [int(i) for i in index.order if np.isfinite(T[i]).all()]
    limit = _step_limit_m(T, index, placed)
    segments: list[list[int]] = []
    warnings = []
    for k, i in enumerate(placed):
        if k == 0 or _distance_m(T, placed[k - 1], i) > limit(placed[k - 1], i):
            if k:
                jump_m, before = _distance_m(T, placed[k - 1], i), index.names[placed[k - 1]]
                warnings.append(
                    f"the poses jump {jump_m:.1f} m between {before} and {index.names[i]}"
                )
            segments.append([])
        segments[-1].append(i)
    components = np.full(len(T), -1)
    for number, segment in enumerate(sorted(segments, key=len, reverse=True)):
        components[segment] = number
    return components, warnings


def _step_limit_m(
    T: NDArray[np.float64], index: FrameIndex, placed: list[int]
) -> Callable[[int, int], float]:
    """How far two frames may lie apart: by the vehicle's speed where both have times, else by the
    usual step.
    """
    steps = np.array([_distance_m(T, a, b) for a, b in pairwise(placed)])
    usual = max(MIN_JUMP_M, JUMP_STEPS * float(np.median(steps))) if len(steps) else MIN_JUMP_M
    elapsed = np.abs(np.diff(index.timestamps_s[placed]))
    speeds = steps[elapsed > 0] / elapsed[elapsed > 0]
    usual_m_s = float(np.median(speeds)) if len(speeds) else 0.0
    fastest_m_s = max(MAX_SPEED_M_S, JUMP_SPEEDS * usual_m_s)

    def limit(a: int, b: int) -> float:
        elapsed_s = index.timestamps_s[b] - index.timestamps_s[a]
        return max(MIN_JUMP_M, fastest_m_s * abs(elapsed_s)) if np.isfinite(elapsed_s) else usual

    return limit


def _distance_m(T: NDArray[np.float64], a: int, b: int) -> float:
    return float(np.linalg.norm(T[a, :3, 3] - T[b, :3, 3]))
