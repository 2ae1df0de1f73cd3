"""Sparse linear equations in blocks of six unknowns, the pose of one frame each; a block is coupled
with few others.

Reverse Cuthill-McKee (George and Liu 1981) puts coupled blocks near each other. Then parts of as
many blocks as the bandwidth are coupled with the parts beside them alone: a block tridiagonal
matrix, solved by Cholesky's method part by part.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.sparse import bsr_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from stereo_seecolor.records import Array

Integers = NDArray[np.int64]

SIDE = 6
"""Of a block."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The order of the blocks. place: (N,) where each block comes. size: blocks in a part."""

    place: Integers
    size: int

    @classmethod
    def of(cls, joined: csr_array) -> "Layout":
        """Order blocks so that coupled ones are close. joined: (N, N), symmetric: coupled."""
        place = np.empty(joined.shape[0], np.int64)
        place[reverse_cuthill_mckee(joined, symmetric_mode=True)] = np.arange(len(place))
        row, column = joined.nonzero()
        reach = max(1, int(np.abs(place[row] - place[column]).max(initial=0)))
        return cls(place, reach if 2 * reach < len(place) else len(place))

    def zeros(self) -> "FrameBlocks":
        """Equations to be filled."""
        parts, width = -(-len(self.place) // self.size), SIDE * self.size
        blocks = FrameBlocks(
            self,
            np.zeros((parts, width, width)),
            np.zeros((parts - 1, width, width)),
            np.zeros(parts * width),
        )
        unused = np.arange(SIDE * len(self.place), parts * width)
        blocks.diagonal[unused // width, unused % width, unused % width] = 1
        return blocks


@dataclass(frozen=True, eq=False)
class FrameBlocks:
    """A block tridiagonal system. diagonal: (K, w, w), of which the lower triangles count, below:
    (K - 1, w, w). g: (K w,) right side.
    """

    layout: Layout
    diagonal: Array
    below: Array
    g: Array

    def add(self, first: int, second: int, H: Array) -> None:
        """Add H (6, 6), rows of the first block, columns of the second; of two blocks that differ
        also its transpose.
        """
        size = self.layout.size
        row = int(self.layout.place[first])
        column = int(self.layout.place[second])
        if row < column:
            row, column, H = column, row, H.T
        part = (
            self.diagonal[row // size]
            if row // size == column // size
            else self.below[column // size]
        )
        i, j = SIDE * (row % size), SIDE * (column % size)
        part[i : i + SIDE, j : j + SIDE] += H

    def add_right(self, block: int, g: Array) -> None:
        """Add g (6,)."""
        at = SIDE * int(self.layout.place[block])
        self.g[at : at + SIDE] += g

    def subtract(self, first: int, coupled: bsr_array, g: Array) -> None:
        """Subtract some rows of blocks (6, 6) of a symmetric matrix, and of the right side, both in
        the order of the places, from that of ``first`` on.
        """
        size = self.layout.size
        row = first + np.repeat(np.arange(len(coupled.indptr) - 1), np.diff(coupled.indptr))
        column = coupled.indices
        within = (column <= row) & (row // size == column // size)
        across = (column <= row) & (row // size != column // size)
        for parts, chosen in ((self.diagonal, within), (self.below, across)):
            blocks = parts.reshape(-1, size, SIDE, size, SIDE)
            i, j = row[chosen], column[chosen]
            blocks[j // size, i % size, :, j % size] -= coupled.data[chosen]
        self.g[SIDE * first :][: len(g)] -= g

    def solve(self) -> Array:
        """Solve the system: (N, 6). Raises LinAlgError where it is singular."""
        return self._solve(self.g)

    def solve_for(self, right: Array) -> Array:
        """Solve the system for another right side (N, 6): (N, 6). Raises LinAlgError."""
        g = np.zeros_like(self.g)
        g.reshape(-1, SIDE)[self.layout.place] = right
        return self._solve(g)

    def _solve(self, g: Array) -> Array:
        left = g.reshape(len(self.diagonal), -1).copy()
        for k, (L, coupling) in enumerate(self._factors):
            left[k] = solve_triangular(L, left[k], lower=True)
            if coupling is not None:
                left[k + 1] -= coupling @ left[k]
        for k, (L, coupling) in reversed(list(enumerate(self._factors))):
            if coupling is not None:
                left[k] -= coupling.T @ left[k + 1]
            left[k] = solve_triangular(L, left[k], lower=True, trans="T")
        return np.asarray(left.reshape(-1, SIDE)[self.layout.place])

    def covariances(self) -> Array:
        """Compute the blocks on the diagonal of the inverse: (N, 6, 6). Raises LinAlgError."""
        size, after, found = self.layout.size, None, []
        for L, coupling in reversed(self._factors):
            own = cho_solve((L, True), np.eye(len(L), order="F"), overwrite_b=True)
            if after is not None and coupling is not None:
                by_next = solve_triangular(L, coupling.T, lower=True, trans="T")
                own += by_next @ after @ by_next.T
            found.append(
                np.stack([own[i : i + SIDE, i : i + SIDE] for i in range(0, SIDE * size, SIDE)])
            )
            after = own
        return np.asarray(np.concatenate(found[::-1])[self.layout.place])

    @cached_property
    def _factors(self) -> list[tuple[Array, Array | None]]:
        """Of each part its Cholesky factor, and that of the part below it, None for the last; in
        place of the equations, which nothing else needs then.
        """
        factors: list[tuple[Array, Array | None]] = []
        for k, own in enumerate(self.diagonal):
            coupling = factors[-1][1] if k else None
            if coupling is not None:
                own -= coupling @ coupling.T
            L = own.T  # by columns, as LAPACK has it
            L[:] = cholesky(own, lower=True, check_finite=False)
            if k < len(self.below):
                self.below[k] = solve_triangular(
                    L, self.below[k].T, lower=True, check_finite=False
                ).T
            factors.append((L, self.below[k] if k < len(self.below) else None))
        return factors
