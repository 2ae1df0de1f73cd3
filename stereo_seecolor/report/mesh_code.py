"""Triangles of a mesh in few bytes, for the page: some three bits each.

The mesh is walked from triangle to triangle across the edges around what has been walked so far
(the cut-border machine, Gumhold and Strasser 1998): a step says where the corner beyond an edge
lies. Vertices come in the order in which the walk meets them, each as its difference from the
vertex beside which it is met. web/src/walk.ts walks the same way.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.files.deflate import deflated_runs
from stereo_seecolor.texture.surface import neighbors

NEW, BEFORE, AFTER, NONE, FAR = range(5)
"""Steps across an edge: the corner beyond it is a new vertex, the start of the edge before it
around what is walked, the end of the edge after it, missing (no triangle), or any other.
"""
START, END, FACE, PREVIOUS, NEXT = range(5)
"""Of an edge around what is walked: its vertices, the triangle beyond, and the edges beside it."""
PLACE, FIRST, VERTEX, BESIDE = range(4)
"""Of each vertex its place in the order, and the edge that starts there; of each place its vertex,
and the place of the one beside it.
"""
MET, NAMED, EDGES = range(3)
"""Counts of vertices that are met, of those that are named, and of edges."""
CLOSED = -2
"""As FACE: the walk has been there."""


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk over a mesh.

    vertex (N,): the vertices in its order. beside (N,): the place there of the one beside which
    each was met, at least -1. steps (S,): what lies across each edge. far (R,): vertices that are
    named, as how far each lies before the next new one; 0 is that one itself.
    """

    vertex: NDArray[np.int64]
    beside: NDArray[np.int64]
    steps: NDArray[np.uint8]
    far: NDArray[np.int64]

    @classmethod
    def over(cls, triangles: NDArray[np.integer]) -> "Walk":
        """Walk over triangles (T, 3) of which neighbors face the same side."""
        number = int(triangles.max()) + 1
        order = np.full((4, number), -1, np.int64)
        steps, far = np.empty(4 * len(triangles), np.uint8), np.empty(3 * len(triangles), np.int64)
        edges = np.empty((3 * len(triangles), 5), np.int64)
        across = neighbors(triangles.astype(np.int32))
        met, stepped, named = _walk(triangles.astype(np.int64), across, edges, order, steps, far)
        return cls(order[VERTEX, :met], order[BESIDE, :met], steps[:stepped], far[:named])

    def packed(self) -> dict[str, bytes]:
        """The steps, three a byte, and the vertices that are named."""
        filled = np.append(self.steps, np.zeros(-len(self.steps) % 3, np.uint8)).reshape(-1, 3)
        steps = filled @ np.array([1, 5, 25], np.uint8)
        return {"steps": deflated_runs(steps.tobytes()), "far": _planes(self.far)}

    def differences(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        """(C, N) of values (V, C) of the vertices from those beside them; 0 is beside the first."""
        columns = values[self.vertex].T
        return columns - np.where(self.beside >= 0, columns[:, self.beside], 0)

    def packed_values(self, values: NDArray[np.int64]) -> bytes:
        """Whole numbers (V, C) of less than 23 bits of the vertices, as their differences."""
        differences = self.differences(values)
        return _planes(((differences << 1) ^ (differences >> 63)).ravel())


def _planes(numbers: NDArray[np.int64]) -> bytes:
    """Three bytes of each number, the lowest of all first."""
    planes = [(numbers >> (8 * i)) & 255 for i in range(3)]
    return deflated_runs(np.stack(planes).astype(np.uint8).tobytes())


@compiled
def _walk(triangles, across, edges, order, steps, far):  # type: ignore[no-untyped-def]
    """Fill ``order``, ``steps`` and ``far``; how many of each there are. order: of each vertex its
    place there and the edge that starts at it, -1 before it is met; of each place its vertex and
    the one beside it.
    """
    walked, counts = np.zeros(len(triangles), np.bool_), np.zeros(3, np.int64)
    edge = stepped = 0
    for begin in range(len(triangles)):
        if walked[begin]:
            continue
        walked[begin] = True
        _begin(triangles, across, begin, edges, order, far, counts)
        while edge < counts[EDGES]:
            face = edges[edge, FACE]
            if face != CLOSED:
                edges[edge, FACE] = CLOSED
                steps[stepped] = NONE
                if face >= 0 and not walked[face]:
                    side = _side(triangles, face, edges[edge, START], edges[edge, END])
                    if side >= 0:
                        walked[face] = True
                        corner = triangles[face, (side + 2) % 3]
                        to, out = across[face, (side + 1) % 3], across[face, (side + 2) % 3]
                        steps[stepped] = _step(
                            edge, face, corner, to, out, edges, order, far, counts
                        )
                stepped += 1
            edge += 1
    return counts[MET], stepped, counts[NAMED]


@compiled
def _begin(triangles, across, begin, edges, order, far, counts):  # type: ignore[no-untyped-def]
    """Begin at a triangle that no edge leads to."""
    start = counts[EDGES]
    for k in range(3):
        corner = triangles[begin, k]
        if order[PLACE, corner] < 0:
            far[counts[NAMED]] = 0
            _meet(corner, counts[MET] - 1, order, counts)
        else:
            far[counts[NAMED]] = counts[MET] - order[PLACE, corner]
        counts[NAMED] += 1
        _add(corner, triangles[begin, (k + 1) % 3], across[begin, k], edges, order, counts)
    for k in range(3):
        _join(start + k, start + (k + 1) % 3, edges)


@compiled
def _meet(vertex, beside, order, counts):  # type: ignore[no-untyped-def]
    order[PLACE, vertex] = counts[MET]
    order[VERTEX, counts[MET]] = vertex
    order[BESIDE, counts[MET]] = beside
    counts[MET] += 1


@compiled
def _add(start, end, face, edges, order, counts):  # type: ignore[no-untyped-def]
    """Add an edge; its number."""
    number = counts[EDGES]
    edges[number, START], edges[number, END], edges[number, FACE] = start, end, face
    order[FIRST, start] = number
    counts[EDGES] += 1
    return number


@compiled
def _join(one, other, edges):  # type: ignore[no-untyped-def]
    edges[one, NEXT], edges[other, PREVIOUS] = other, one


@compiled
def _side(triangles, face, start, end):  # type: ignore[no-untyped-def]
    """The side of a triangle that an edge is; -1 if the triangle faces the other side."""
    for k in range(3):
        if triangles[face, k] == end and triangles[face, (k + 1) % 3] == start:
            return k
    return -1


@compiled
def _step(edge, face, corner, across_to, across_out, edges, order, far, counts):  # type: ignore[no-untyped-def]
    """Step across an edge into a triangle with a corner beyond. across_to, across_out: the
    triangles across its sides to and from that corner.
    """
    start, end = edges[edge, START], edges[edge, END]
    before, after = edges[edge, PREVIOUS], edges[edge, NEXT]
    if edges[before, FACE] == face and edges[before, START] == corner:
        edges[before, FACE] = CLOSED
        new = _add(corner, end, across_out, edges, order, counts)
        _join(edges[before, PREVIOUS], new, edges)
        _join(new, after, edges)
        return BEFORE
    if edges[after, FACE] == face and edges[after, END] == corner:
        edges[after, FACE] = CLOSED
        new = _add(start, corner, across_to, edges, order, counts)
        _join(before, new, edges)
        _join(new, edges[after, NEXT], edges)
        return AFTER
    other = order[FIRST, corner]
    to = _add(start, corner, across_to, edges, order, counts)
    out = _add(corner, end, across_out, edges, order, counts)
    _join(before, to, edges)
    _join(out, after, edges)
    if order[PLACE, corner] < 0:
        _meet(corner, order[PLACE, end], order, counts)
        _join(to, out, edges)
        return NEW
    far[counts[NAMED]] = counts[MET] - order[PLACE, corner]
    counts[NAMED] += 1
    last = edges[other, PREVIOUS]  # the ring of edges parts here, or joins another
    _join(to, other, edges)
    _join(last, out, edges)
    return FAR
