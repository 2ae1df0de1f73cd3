"""Finds grids among flat patches: rows and columns of a chart, rotated and tilted in any way."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from stereo_seecolor.extras.evaluation.charts.flat_patches import FlatPatches
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class LatticeLimits:
    """Limits for neighbors in a grid."""

    neighbors: int = 8
    """Nearest patches that are tried as neighbors."""
    nearest: float = 0.9
    farthest: float = 2.2
    """Distance of neighbors over a patch's side: a gap as wide as it, and tilts of 50 degrees."""
    least_angle_deg: float = 50.0
    """Least angle between rows and columns."""
    likeness: float = 0.6
    """Least ratio of the sides of two neighbors."""
    tolerance: float = 0.17
    """Distance of a patch from its place in the grid, fraction of the grid's shorter step."""
    least_support: int = 3
    """Least patches that continue the grid of a first patch and two neighbors: as two rows have."""
    most_seeds: int = 60
    """Places of an image that are tried."""
    least_cells: int = 6
    homography_from: int = 9
    """Patches: fewer are too few to tell perspective from noise."""
    rounds: int = 16


LIMITS = LatticeLimits()
_AROUND = np.array([[-1, 0], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]])


@dataclass(frozen=True, eq=False)
class Lattice:
    """A grid. cells: (N, 2) column and row of each patch, as in the image (never mirrored). pixels:
    (N, 2) their middles.
    """

    cells: NDArray[np.int64]
    pixels: Array


def lattices(patches: FlatPatches) -> Iterator[Lattice]:
    """The grids of patches, the best supported first; no patch is in two."""
    if len(patches.centers) < LIMITS.least_cells:
        return
    tree = KDTree(patches.centers)
    taken: set[int] = set()
    for seed in _seeds(patches, tree):
        if taken.isdisjoint(seed):
            of = _grown(patches, tree, seed)
            if len(of) >= LIMITS.least_cells:
                taken |= set(of.values())
                yield Lattice(np.array(list(of), np.int64), patches.centers[list(of.values())])


def _seeds(patches: FlatPatches, tree: KDTree) -> list[tuple[int, int, int]]:
    """Seeds of grids: a patch, the next in its row and in its column, that others continue."""
    first, second, third = _corners(patches, tree)
    if not len(first):
        return []
    u, v = (
        patches.centers[second] - patches.centers[first],
        patches.centers[third] - patches.centers[first],
    )
    step = np.minimum(np.hypot(*u.T), np.hypot(*v.T))
    expected = (
        patches.centers[first][:, None] + u[:, None] * _AROUND[:, :1] + v[:, None] * _AROUND[:, 1:]
    )
    distance, at = tree.query(expected, distance_upper_bound=LIMITS.tolerance * float(step.max()))
    at = np.minimum(at, len(patches.sides) - 1)
    met = (distance < LIMITS.tolerance * step[:, None]) & _alike(
        patches.sides[at], patches.sides[first][:, None]
    )
    support = met.sum(axis=1)
    order = np.argsort(-support, kind="stable")
    order = order[support[order] >= LIMITS.least_support][: 4 * LIMITS.most_seeds]
    unique = {int(first[k]): (int(first[k]), int(second[k]), int(third[k])) for k in order[::-1]}
    return list(unique.values())[::-1][: LIMITS.most_seeds]


def _corners(
    patches: FlatPatches, tree: KDTree
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Every patch with two neighbors in about perpendicular directions, the second clockwise."""
    count = len(patches.sides)
    found: Any = tree.query(patches.centers, k=min(LIMITS.neighbors + 1, count))
    distance, near = found[0][:, 1:], found[1][:, 1:]
    ratio = distance / patches.sides[:, None]
    usable = (
        (ratio > LIMITS.nearest)
        & (ratio < LIMITS.farthest)
        & _alike(patches.sides[near], patches.sides[:, None])
    )
    direction = (patches.centers[near] - patches.centers[:, None]) / np.maximum(distance, 1e-9)[
        ..., None
    ]
    x, y = direction[..., 0], direction[..., 1]
    cross = x[:, :, None] * y[:, None, :] - y[:, :, None] * x[:, None, :]
    square = (
        (cross > np.sin(np.radians(LIMITS.least_angle_deg)))
        & usable[:, :, None]
        & usable[:, None, :]
    )
    first, a, b = np.nonzero(square)
    return first, near[first, a], near[first, b]


def _alike(sides: Array, others: Array) -> NDArray[np.bool_]:
    return (sides > LIMITS.likeness * others) & (others > LIMITS.likeness * sides)


def _grown(
    patches: FlatPatches, tree: KDTree, seed: tuple[int, int, int]
) -> dict[tuple[int, int], int]:
    """The grid of a seed, extended as far as patches continue it: column and row -> patch."""
    of = dict(zip([(0, 0), (1, 0), (0, 1)], seed, strict=True))
    side = patches.sides[list(seed)].mean()
    for _ in range(LIMITS.rounds):
        cells = np.array(list(of))
        onto = onto_pixels(cells, patches.centers[list(of.values())])
        low, high = cells.min(axis=0) - 1, cells.max(axis=0) + 1
        new = [
            cell
            for cell in product(range(low[0], high[0] + 1), range(low[1], high[1] + 1))
            if cell not in of
        ]
        expected = moved(onto, np.array(new))
        step = _step(onto, cells)
        nearest: Any = tree.query(expected, distance_upper_bound=LIMITS.tolerance * step)
        used, before = set(of.values()), len(of)
        for cell, far, patch in zip(new, *nearest, strict=True):
            if np.isfinite(far) and patch not in used and _alike(patches.sides[patch], side):
                of[cell] = int(patch)
                used.add(int(patch))
        if len(of) == before or len(of) > 300:
            break
    return of


def onto_pixels(cells: NDArray[np.number], pixels: Array) -> Array:
    """(3, 3) homography from a grid to the image, by least squares; affine for few points."""
    cells = np.asarray(cells, np.float64)
    if len(cells) >= LIMITS.homography_from and (np.ptp(cells, axis=0) >= 2).all():
        fitted = cv2.findHomography(cells, pixels)[0]
        if fitted is not None:
            return np.asarray(fitted, np.float64)
    A = np.linalg.lstsq(np.column_stack([cells, np.ones(len(cells))]), pixels, rcond=None)[0].T
    return np.vstack([A, [0.0, 0.0, 1.0]])


def moved(onto: Array, points: NDArray[np.number]) -> Array:
    """(..., 2) points (..., 2) mapped by a homography (3, 3)."""
    homogeneous = np.asarray(points, np.float64) @ onto[:, :2].T + onto[:, 2]
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:], np.float64)


def _step(onto: Array, cells: NDArray[np.number]) -> float:
    """The shorter step of the grid at its middle, pixels."""
    middle = np.asarray(cells).mean(axis=0)
    around = moved(onto, middle + np.array([[0, 0], [1, 0], [0, 1]]))
    return float(np.hypot(*(around[1:] - around[0]).T).min())
