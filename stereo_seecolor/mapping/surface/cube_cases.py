"""Table of marching cubes: the triangles of a cube of eight voxels, for each way in which its
corners lie inside and outside.

Marching cubes (Lorensen and Cline 1987). The table is worked out, not listed: on each face of the
cube, every run of corners inside is cut off by a segment of its own, so that two cubes agree on the
face between them and the surface has no holes; the segments join to loops, which are filled with
triangles.

Corner x + 2 y + 4 z of a cube lies at (x, y, z); bit c of a case is set where corner c is inside.
"""

from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

MOST_TRIANGLES = 5
"""Of one cube."""

EDGES: NDArray[np.int64] = np.array(
    [
        [x, y, z, axis]
        for axis in range(3)
        for z, y, x in product(range(2), repeat=3)
        if (x, y, z)[axis] == 0
    ]
)
"""(12, 4) x, y, z of an edge's lower corner in the cube, and its axis."""

_EDGE_BETWEEN = {
    frozenset((low := x + 2 * y + 4 * z, low + (1 << axis))): edge
    for edge, (x, y, z, axis) in enumerate(EDGES.tolist())
}


def _faces() -> list[list[int]]:
    """The corners of the six faces, counterclockwise as seen from outside."""
    faces = []
    for axis in range(3):
        u, v, side = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3, 1 << axis
        faces += [[side, side + u, side + u + v, side + v], [0, v, u + v, u]]
    return faces


_FACES = _faces()
_FACES_OF = [
    {f for f, face in enumerate(_FACES) if set(corners) <= set(face)} for corners in _EDGE_BETWEEN
]


def _loops(case: int) -> list[list[int]]:
    """The edges of the cube that each piece of the surface passes through, counterclockwise as seen
    from outside of it.
    """
    following: dict[int, int] = {}
    for face in _FACES:
        inside = [bool(case >> corner & 1) for corner in face]
        crossed = [_EDGE_BETWEEN[frozenset((face[i - 1], face[i]))] for i in range(4)]
        for i in range(4):
            # a run of corners inside begins: it ends before the next one outside
            if inside[i] and not inside[i - 1]:
                end = next(j % 4 for j in range(i + 1, i + 4) if not inside[j % 4])
                following[crossed[i]] = crossed[end]
    loops = []
    while following:
        loop = [min(following)]
        while (edge := following.pop(loop[-1])) != loop[0]:
            loop.append(edge)
        loops.append(loop)
    return loops


def _fan(loop: list[int]) -> list[list[int]]:
    """Triangles that fill a loop, none of whose inner sides lies in a face of the cube where that
    can be: two cubes might both have it there.
    """
    turned = [loop[i:] + loop[:i] for i in range(len(loop))]
    inner = [[(t[0], t[k]) for k in range(2, len(t) - 1)] for t in turned]
    hidden = [all(not _FACES_OF[a] & _FACES_OF[b] for a, b in sides) for sides in inner]
    chosen = turned[hidden.index(True) if True in hidden else 0]
    return [[chosen[0], chosen[k], chosen[k + 1]] for k in range(1, len(chosen) - 1)]


@cache
def cube_cases() -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Compute the number of triangles of each case (256,), and the edges that their corners lie on
    (256, MOST_TRIANGLES, 3).
    """
    counts, edges = np.zeros(256, np.int8), np.zeros((256, MOST_TRIANGLES, 3), np.int8)
    for case in range(256):
        triangles = [triangle for loop in _loops(case) for triangle in _fan(loop)]
        counts[case] = len(triangles)
        edges[case, : len(triangles)] = triangles if triangles else np.zeros((0, 3))
    return counts, edges
