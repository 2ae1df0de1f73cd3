"""Connected components of frames by relative-pose edges, with a first estimate of their poses."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import inverse, rotation_vector
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array

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
    from scipy.sparse import csr_array
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
    """Edges that join two components count only if at least two of them agree."""

    def joint(edge: Edge) -> Array:
        return np.asarray(T[edge.i] @ edge.T_i_j @ inverse(T[edge.j]))

    def agree(a: Edge, b: Edge) -> bool:
        first = joint(a)
        second = joint(b) if components[a.i] == components[b.i] else inverse(joint(b))
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
