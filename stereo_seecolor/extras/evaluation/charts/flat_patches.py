"""Finds small flat regions with straight outlines in an image, as the patches of a color chart
are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Floats = NDArray[np.float32]
Array = NDArray[np.float64]
Levels = NDArray[np.uint16]


@dataclass(frozen=True)
class PatchLimits:
    """Limits of a patch, in pixels of an image that is halved until its patches are small."""

    octaves: int = 6
    """Sizes of the image, from twice its size, each half of the one before: patches of 4 to 200
    pixels.
    """
    window_px: int = 25
    """Window in which edges are compared: a patch and its neighbors."""
    flat: float = 0.6
    """Fraction of the mean edge in the window: inner pixels of a patch have weaker edges."""
    least_area: int = 6
    most_area: int = 600
    """Least and most flat pixels of a patch, without its border and blurred pixels."""
    least_fill: float = 0.85
    """Area over that of the parallelogram with the same second moments (1; an ellipse has 1.05, an
    L 0.8).
    """
    most_stretch: float = 3.0
    """Long over short side: a patch of two units, tilted by 50 degrees."""
    border_px: float = 2.5
    """Pixels by which the flat part of a patch is narrower than the patch."""


PATCH_LIMITS = PatchLimits()


@dataclass(frozen=True, eq=False)
class FlatPatches:
    """Flat regions. centers: (N, 2) pixels of the full image. sides: (N,) side of a square of the
    same area, in its pixels.
    """

    centers: Array
    sides: Array


def flat_patches(picture: Floats) -> Iterator[FlatPatches]:
    """The flat regions of (H, W, 3) for each size of patch, the smallest first."""
    for sized, pixel in pyramid(picture):
        found = _of_size(sized)
        yield FlatPatches((found.centers + 0.5) * pixel - 0.5, found.sides * pixel)


def pyramid(picture: Floats) -> Iterator[tuple[Levels, float]]:
    """The image (H, W, 3) at twice its size, then halved repeatedly; each with the width of its
    pixels in those of the image.
    """
    # morphology is several times faster on whole numbers
    levels = np.asarray(picture * 65535, np.uint16)
    sized = _resized(levels, 2.0)
    for octave in range(PATCH_LIMITS.octaves):
        if min(sized.shape[:2]) < PATCH_LIMITS.window_px:
            return
        yield sized, 2.0 ** (octave - 1)
        sized = _resized(sized, 0.5) if octave else levels


def _resized(levels: Levels, factor: float) -> Levels:
    kind = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(levels, None, fx=factor, fy=factor, interpolation=kind), np.uint16)


def flat_regions(picture: Levels) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(H, W) number of the flat region of each pixel, 0 for none; and (N, 5) box and area of each
    region.
    """
    edge = _edges(picture)
    flat = edge < PATCH_LIMITS.flat * cv2.blur(
        edge, (PATCH_LIMITS.window_px, PATCH_LIMITS.window_px)
    )
    flat[[0, -1]] = flat[:, [0, -1]] = False
    _, labels, stats, _ = cv2.connectedComponentsWithStats(flat.astype(np.uint8), connectivity=4)
    return labels, stats


def _of_size(picture: Levels) -> FlatPatches:
    labels, stats = flat_regions(picture)
    area = stats[:, cv2.CC_STAT_AREA]
    possible = (area >= PATCH_LIMITS.least_area) & (area <= PATCH_LIMITS.most_area)
    possible[0] = False
    number = np.cumsum(possible) - 1
    y, x = np.nonzero(possible[labels])
    return _compact(
        number[labels[y, x]], np.stack([x, y], axis=1).astype(np.float64), int(possible.sum())
    )


def _edges(picture: Levels) -> Floats:
    """(H, W) largest difference within 3 x 3 pixels in any channel."""
    smooth = cv2.GaussianBlur(picture, (3, 3), 0.7)
    square = np.ones((3, 3), np.uint8)
    red, green, blue = cv2.split(
        cv2.subtract(cv2.dilate(smooth, square), cv2.erode(smooth, square))
    )
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.float32)


def _compact(region: NDArray[np.intp], pixels: Array, count: int) -> FlatPatches:
    """The regions that may be parallelograms. region: (P,) region of each pixel. pixels: (P, 2).
    count: number of regions.
    """
    area = np.bincount(region, minlength=count).astype(np.float64)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(region, values, minlength=count) / np.maximum(area, 1))

    centers = np.stack([mean(pixels[:, 0]), mean(pixels[:, 1])], axis=1)
    dx, dy = (pixels - centers[region]).T
    xx, yy, xy = mean(dx * dx) + 1 / 12, mean(dy * dy) + 1 / 12, mean(dx * dy)
    half_trace, determinant = (xx + yy) / 2, np.maximum(xx * yy - xy * xy, 1e-9)
    difference = np.sqrt(np.maximum(half_trace**2 - determinant, 0))
    stretch = np.sqrt((half_trace + difference) / np.maximum(half_trace - difference, 1e-9))
    good = (area > PATCH_LIMITS.least_fill * 12 * np.sqrt(determinant)) & (
        stretch < PATCH_LIMITS.most_stretch
    )
    return FlatPatches(centers[good], np.sqrt(area[good]) + PATCH_LIMITS.border_px)


# Finds grids among flat patches: the rows and columns of a chart, rotated and tilted in any way.


@dataclass(frozen=True)
class LatticeLimits:
    """Limits for neighbors in a grid."""

    neighbors: int = 8
    """Nearest patches that are tried as neighbors."""
    nearest: float = 0.9
    farthest: float = 2.2
    """Distance of neighbors over the side of a patch: a gap as wide as the patch, and tilts of 50
    degrees.
    """
    least_angle_deg: float = 50.0
    """Least angle between rows and columns."""
    likeness: float = 0.6
    """Least ratio of the sides of two neighbors."""
    tolerance: float = 0.17
    """Distance of a patch from its place in the grid, as a fraction of the shorter of the grid's
    two steps.
    """
    least_support: int = 3
    """Patches that continue the grid of a first patch and two of its neighbors, at least: as two
    rows have.
    """
    most_seeds: int = 60
    """Places of an image that are tried."""
    least_cells: int = 6
    homography_from: int = 9
    """Patches: fewer are too few to tell perspective from noise."""
    rounds: int = 16


LATTICE_LIMITS = LatticeLimits()
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
    if len(patches.centers) < LATTICE_LIMITS.least_cells:
        return
    tree = KDTree(patches.centers)
    taken: set[int] = set()
    for seed in _seeds(patches, tree):
        if taken.isdisjoint(seed):
            of = _grown(patches, tree, seed)
            if len(of) >= LATTICE_LIMITS.least_cells:
                taken |= set(of.values())
                yield Lattice(np.array(list(of), np.int64), patches.centers[list(of.values())])


def _seeds(patches: FlatPatches, tree: KDTree) -> list[tuple[int, int, int]]:
    """Seeds of grids: a patch, the next in its row and the next in its column, at places where
    other patches continue them.
    """
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
    distance, at = tree.query(
        expected, distance_upper_bound=LATTICE_LIMITS.tolerance * float(step.max())
    )
    at = np.minimum(at, len(patches.sides) - 1)
    met = (distance < LATTICE_LIMITS.tolerance * step[:, None]) & _alike(
        patches.sides[at], patches.sides[first][:, None]
    )
    support = met.sum(axis=1)
    order = np.argsort(-support, kind="stable")
    order = order[support[order] >= LATTICE_LIMITS.least_support][: 4 * LATTICE_LIMITS.most_seeds]
    unique = {int(first[k]): (int(first[k]), int(second[k]), int(third[k])) for k in order[::-1]}
    return list(unique.values())[::-1][: LATTICE_LIMITS.most_seeds]


def _corners(
    patches: FlatPatches, tree: KDTree
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Every patch with two of its neighbors in about perpendicular directions, the second clockwise
    of the first.
    """
    count = len(patches.sides)
    found: Any = tree.query(patches.centers, k=min(LATTICE_LIMITS.neighbors + 1, count))
    distance, near = found[0][:, 1:], found[1][:, 1:]
    ratio = distance / patches.sides[:, None]
    usable = (
        (ratio > LATTICE_LIMITS.nearest)
        & (ratio < LATTICE_LIMITS.farthest)
        & _alike(patches.sides[near], patches.sides[:, None])
    )
    direction = (patches.centers[near] - patches.centers[:, None]) / np.maximum(distance, 1e-9)[
        ..., None
    ]
    x, y = direction[..., 0], direction[..., 1]
    cross = x[:, :, None] * y[:, None, :] - y[:, :, None] * x[:, None, :]
    square = (
        (cross > np.sin(np.radians(LATTICE_LIMITS.least_angle_deg)))
        & usable[:, :, None]
        & usable[:, None, :]
    )
    first, a, b = np.nonzero(square)
    return first, near[first, a], near[first, b]


def _alike(sides: Array, others: Array) -> NDArray[np.bool_]:
    return (sides > LATTICE_LIMITS.likeness * others) & (others > LATTICE_LIMITS.likeness * sides)


def _grown(
    patches: FlatPatches, tree: KDTree, seed: tuple[int, int, int]
) -> dict[tuple[int, int], int]:
    """The grid of a seed, extended as far as patches continue it: column and row -> patch."""
    of = dict(zip([(0, 0), (1, 0), (0, 1)], seed, strict=True))
    side = patches.sides[list(seed)].mean()
    for _ in range(LATTICE_LIMITS.rounds):
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
        nearest: Any = tree.query(expected, distance_upper_bound=LATTICE_LIMITS.tolerance * step)
        used, before = set(of.values()), len(of)
        for cell, far, patch in zip(new, *nearest, strict=True):
            if np.isfinite(far) and patch not in used and _alike(patches.sides[patch], side):
                of[cell] = int(patch)
                used.add(int(patch))
        if len(of) == before or len(of) > 300:
            break
    return of


def onto_pixels(cells: NDArray[np.number], pixels: Array) -> Array:
    """(3, 3) homography from a grid to the image, by least squares; affine where points are few or
    in one line.
    """
    cells = np.asarray(cells, np.float64)
    if len(cells) >= LATTICE_LIMITS.homography_from and (np.ptp(cells, axis=0) >= 2).all():
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
