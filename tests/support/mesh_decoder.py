"""Reads the meshes of the page's scripts, as web/src/walk.ts and web/src/pieces.ts do."""

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.report.mesh_code import AFTER, BEFORE, FAR, NEW, NONE


def triangles_of(packed: dict[str, Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The triangles (T, 3), and of each vertex the one that its values differ from (N,)."""
    packed_steps = np.frombuffer(zlib.decompress(packed["steps"]), np.uint8)
    steps = iter((packed_steps[:, None] // [1, 5, 25] % 5).ravel().tolist())
    far = iter(_numbers(packed["far"]).tolist())
    triangles, beside = list[tuple[int, int, int]](), list[int]()
    ring, edge = _Ring(), 0
    while len(triangles) < packed["triangles"]:
        if edge == len(ring.ends):
            corners = list[int]()
            for _ in range(3):
                corners.append(len(beside) - next(far))
                if corners[-1] == len(beside):
                    beside.append(len(beside) - 1)
            triangles.append((corners[0], corners[1], corners[2]))
            added = [ring.add(corners[k], corners[(k + 1) % 3]) for k in range(3)]
            for k in range(3):
                ring.join(added[k], added[(k + 1) % 3])
        edge += 1
        if edge - 1 in ring.closed or (step := next(steps)) == NONE:
            continue
        (start, end), before, after = (
            ring.ends[edge - 1],
            ring.before[edge - 1],
            ring.after[edge - 1],
        )
        if step in (BEFORE, AFTER):
            gone = before if step == BEFORE else after
            ring.closed.add(gone)
            corner = ring.ends[gone][0 if step == BEFORE else 1]
            new = ring.add(corner, end) if step == BEFORE else ring.add(start, corner)
            ring.join(ring.before[gone] if step == BEFORE else before, new)
            ring.join(new, ring.after[gone] if step == AFTER else after)
        else:
            corner = len(beside) if step == NEW else len(beside) - next(far)
            other = ring.first.get(corner, -1)
            to, out = ring.add(start, corner), ring.add(corner, end)
            ring.join(before, to)
            ring.join(out, after)
            if step == NEW:
                beside.append(end)
                ring.join(to, out)
            else:
                assert step == FAR
                last = ring.before[other]
                ring.join(to, other)
                ring.join(last, out)
        triangles.append((end, start, corner))
    return np.array(triangles), np.array(beside)


def values_of(packed: bytes, beside: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N, C) whole numbers of vertices."""
    folded = _numbers(packed).reshape(-1, len(beside)).T
    return _sums((folded >> 1) ^ -(folded & 1), beside)


def colors_of(packed: bytes, beside: NDArray[np.int64]) -> NDArray[np.uint8]:
    """(N, 3) colors of vertices."""
    content = np.frombuffer(zlib.decompress(packed), np.uint8)
    red, green, blue = _sums(content.reshape(3, -1).T.astype(np.int64), beside).T
    steps = np.stack([red + green, green, blue + green], axis=1) % 64
    return (4 * steps + 2).astype(np.uint8)


def _sums(differences: NDArray[np.int64], beside: NDArray[np.int64]) -> NDArray[np.int64]:
    sums = differences.copy()
    for i in range(1, len(sums)):
        sums[i] += sums[beside[i]]
    return sums


def _numbers(packed: bytes) -> NDArray[np.int64]:
    content = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(3, -1).astype(np.int64)
    return np.asarray(content[0] | content[1] << 8 | content[2] << 16)


class _Ring:
    """The edges around what is walked, of which some are closed."""

    def __init__(self) -> None:
        self.ends = list[tuple[int, int]]()
        self.before, self.after = dict[int, int](), dict[int, int]()
        self.first = dict[int, int]()
        self.closed = set[int]()

    def add(self, start: int, end: int) -> int:
        self.ends.append((start, end))
        self.first[start] = len(self.ends) - 1
        return self.first[start]

    def join(self, one: int, other: int) -> None:
        self.after[one], self.before[other] = other, one
