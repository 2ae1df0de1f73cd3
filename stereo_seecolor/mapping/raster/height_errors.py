"""Standard errors of the heights of a terrain, by the shape of the ground around each."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array

ROUGH_CELLS, ROUGH_OVER_CELLS = 2, 4
"""Roughness is what heights within so many cells depart from a plane; it counts over so many."""
OF_ROUGHNESS = 1.1
"""What the roughness around adds to the standard error of a height. This and the parts below are as
benchmarks/standard_errors.py finds them on synthetic reefs.
"""
OF_RELIEF, RELIEF_CELLS = 0.15, 16
"""The part of the relief, over so many cells around, by which a height beside a hole may be off."""
OF_EXTREMES = 0.53
"""The part of its standard error by which a highest or lowest height is off: where one is smoothed
away, the next one takes its place.
"""
HOLE_CELLS = 6.5
"""Cells from a hole over which that falls to 1 / e."""
PLACE_CELLS = 0.7
"""Cells by which the place of a height is off, half of what matching resolves: on a slope that is a
height. A steep slope may also be a step that windows of matching blur, with its foot not seen.
"""
REACH_CELLS = RELIEF_CELLS + 1
"""Cells around one that ``height_stds`` looks at: those of roughness are fewer."""


def height_stds(heights: Array, margin: int = 0) -> Array:
    """(H, W) standard errors of heights (H, W), NaN where unknown; there, that of a height which
    follows from its neighbors. margin: so many cells at each side are looked at, and left out of
    the result.

    What is finer than matching resolves, as gaps between branches, is smoothed away: the roughness
    that is left tells how much, and holds the errors that neighbors do not share.
    """
    needed = min(margin, ROUGH_CELLS + ROUGH_OVER_CELLS)
    near = _inner(heights, margin - needed)
    off_m, rise_m = departure_and_rise(near, ROUGH_CELLS)
    rough_m = np.sqrt(_mean_around(off_m**2, np.isfinite(near), ROUGH_OVER_CELLS))
    parts = (
        _inner(OF_ROUGHNESS * rough_m, needed),
        _inner(PLACE_CELLS * rise_m, needed),
        _inner(stds_beside_holes(heights), margin),
    )
    return np.asarray(np.sqrt(sum(part**2 for part in parts)))


def stds_beside_holes(heights: Array) -> Array:
    """(H, W) errors of heights (H, W), NaN where unknown, by holes: there lies what no frame saw or
    could match, mostly the foot of a step, and what is above reaches over it: a part of the height
    of things around.
    """
    known = np.isfinite(heights)
    around = np.ones((2 * RELIEF_CELLS + 1,) * 2, np.uint8)
    highest, lowest = (
        cv2.dilate(
            np.where(known, sign * heights, -np.inf).astype(np.float64),
            around,
            borderType=cv2.BORDER_CONSTANT,
            borderValue=-np.inf,
        )
        for sign in (1, -1)
    )
    relief_m = np.maximum(highest + lowest, 0)
    seen = np.pad(known, 1).astype(np.uint8)
    off_cells = cv2.distanceTransform(seen, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    beside = np.where(off_cells <= RELIEF_CELLS, np.exp(-off_cells / HOLE_CELLS), 0.0)
    return np.asarray(OF_RELIEF * relief_m * beside)


def _inner(values: Array, margin: int) -> Array:
    """Values (H, W) without a margin at each side."""
    height, width = values.shape
    return values[margin : height - margin, margin : width - margin]


def _mean_around(values: Array, known: NDArray[np.bool_], reach: int) -> Array:
    """(H, W) mean of the known values (H, W) within ``reach`` cells, 0 where there are none."""
    size = (2 * reach + 1,) * 2
    total, count = (
        cv2.boxFilter(each, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for each in (np.where(known, values, 0), known.astype(np.float64))
    )
    return np.asarray(np.maximum(total, 0) / np.maximum(count, 1))


def departure_and_rise(heights: Array, reach: int) -> tuple[Array, Array]:
    """(H, W) each: root mean square of what the known heights within ``reach`` cells depart from a
    plane, and its rise from one cell to the next; 0 where there are none.
    """
    A, b, squares = plane_sums(heights, reach)
    count = np.maximum(A[..., 0, 0], 1)
    flat = np.linalg.det(A) < 0.5  # whole numbers, 0: the cells span no plane and have their mean
    A[flat], b[flat, 1:] = count[flat, None, None] * np.eye(3), 0
    plane = np.linalg.solve(A, b[..., None])[..., 0]
    off = squares - (plane * b).sum(axis=-1)
    return np.sqrt(np.maximum(off, 0) / count), np.hypot(plane[..., 1], plane[..., 2])


def plane_sums(heights: Array, reach: int) -> tuple[Array, Array, Array]:
    """The least-squares plane (height at the middle, rise to the right and downward in cells) of
    the known heights within ``reach`` cells of each: normal matrix (H, W, 3, 3), right side
    (H, W, 3) and sum of squares (H, W), of heights less their median.
    """
    known = np.isfinite(heights)
    level = float(np.median(heights[known])) if known.any() else 0.0
    weight, z = known.astype(np.float64), np.where(known, heights - level, 0)
    rise = np.arange(-reach, reach + 1, dtype=np.float64)
    powers = [np.ones_like(rise), rise, rise**2]

    def total(values: Array, x: int, y: int) -> Array:
        """Sums of values x^x y^y over the window around each cell."""
        return np.asarray(
            cv2.sepFilter2D(
                values, cv2.CV_64F, powers[x], powers[y], borderType=cv2.BORDER_CONSTANT
            )
        )

    powers_of = ((0, 0), (1, 0), (0, 1))
    A = np.stack(
        [
            np.stack([total(weight, x + u, y + v) for u, v in powers_of], axis=-1)
            for x, y in powers_of
        ],
        axis=-2,
    )
    b = np.stack([total(z, x, y) for x, y in powers_of], axis=-1)
    return A, b, total(z**2, 0, 0)
