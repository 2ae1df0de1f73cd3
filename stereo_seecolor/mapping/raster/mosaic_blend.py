"""Views of an orthomosaic blended: each cell from its best view, in the coarse color of the mean of
all views, with soft seams.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.raster.grid import widened

Float = NDArray[np.float32]


@dataclass(frozen=True)
class BlendSettings:
    """How wide seams and bands are."""

    # costs are averaged over it, cells: seams run in straight stretches (Rhemann et al. 2011)
    smooth_px: int = 21
    feather_px: float = 2.0  # standard deviation of the blend across a seam, cells
    # standard deviations beyond which nothing is blended: OpenCV's kernels end at four
    feather_reach: float = 5.0
    # standard deviation, cells: coarser color is that of the mean of all views, finer that of the
    # best view
    band_px: float = 6.0
    # cells along an axis to one of the image in which the coarse color is computed
    coarser: int = 2
    most_change: float = 2.0  # factor, up and down: views that differ by more do not show the same


SETTINGS = BlendSettings()


@dataclass(frozen=True, eq=False)
class SeenCells:
    """What a view sees of a window of cells: all of it lies in a part of the window, of rows and
    columns, in which color (h, w, 3) uint8 and cost (h, w) float32, infinite where it does not see
    the cell.
    """

    part: tuple[slice, slice]
    color: NDArray[np.uint8]
    cost: Float


def blend(views: Sequence[SeenCells], mean: Float) -> NDArray[np.uint8]:
    """Paint each cell from the view of least smoothed cost, in the color of the mean (H, W, 3),
    with soft seams: (4, H, W) RGBA.

    Alpha is 0 where no view sees the cell.
    """
    best = _cheapest(views, mean.shape[:2])
    total, sums = np.zeros(best.shape, np.float32), np.zeros((*best.shape, 3), np.float32)
    for k, view in enumerate(views):
        mine = best == k
        window = _around(mine)
        if window is None:
            continue
        seen, color = np.zeros(best.shape, np.bool_), np.zeros((*best.shape, 3), np.uint8)
        seen[view.part], color[view.part] = np.isfinite(view.cost), view.color
        weight = (
            cv2.GaussianBlur(mine[window].astype(np.float32), (0, 0), SETTINGS.feather_px)
            * seen[window]
        )
        total[window] += weight
        sums[window] += weight[..., None] * _as_the_mean(color, seen, mean, window)
    result = np.zeros((4, *best.shape), np.uint8)
    result[:3] = (
        np.clip(np.rint(sums / np.maximum(total, 1e-6)[..., None]), 0, 255)
        .astype(np.uint8)
        .transpose(2, 0, 1)
    )
    visible = best >= 0
    result[3] = np.where(visible, 255, 0)
    result[:3, ~visible] = 0
    return result


def _as_the_mean(
    color: NDArray[np.uint8], seen: NDArray[np.bool_], mean: Float, window: tuple[slice, slice]
) -> Float:
    """Scale a view's colors in a window so that their coarse band is that of the mean over the
    cells that the view sees.
    """
    reach = int(np.ceil(2 * SETTINGS.band_px))
    # the blur at the window's edge reaches so far
    wide, inner = widened(window, reach, reach, seen.shape)
    own, is_seen = color[wide].astype(np.float32), seen[wide][..., None]
    own_band, mean_band = _coarse_band(own * is_seen), _coarse_band(mean[wide] * is_seen)
    factor = np.clip(
        (mean_band + 1e-3) / (own_band + 1e-3), 1 / SETTINGS.most_change, SETTINGS.most_change
    )
    factor = cv2.resize(factor, own.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(own[inner] * factor[inner], np.float32)


def _coarse_band(color: Float) -> Float:
    """Blur colors (h, w, 3), reduced by SETTINGS.coarser along both axes."""
    height, width = color.shape[:2]
    size = max(width // SETTINGS.coarser, 1), max(height // SETTINGS.coarser, 1)
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    return np.asarray(
        cv2.GaussianBlur(small, (0, 0), SETTINGS.band_px / SETTINGS.coarser), np.float32
    )


def _cheapest(views: Sequence[SeenCells], shape: tuple[int, int]) -> NDArray[np.int16]:
    """For each cell the view of least cost around it: (H, W), -1 where none sees the cell."""
    size, least = (SETTINGS.smooth_px,) * 2, np.full(shape, np.inf, np.float32)
    best = np.full(shape, -1, np.int16)
    for k, view in enumerate(views):
        seen, cost = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        known = np.isfinite(view.cost)
        seen[view.part], cost[view.part] = known, np.where(known, view.cost, np.float32(0))
        mean = cv2.blur(cost, size) / np.maximum(cv2.blur(seen, size), 1e-6)
        better = known & (mean[view.part] < least[view.part])
        least[view.part][better], best[view.part][better] = mean[view.part][better], k
    return best


def _around(chosen: NDArray[np.bool_]) -> tuple[slice, slice] | None:
    """The window of the chosen cells and of all that their blend reaches; None for none."""
    rows, columns = np.flatnonzero(chosen.any(axis=1)), np.flatnonzero(chosen.any(axis=0))
    if not len(rows):
        return None
    reach = int(np.ceil(SETTINGS.feather_reach * SETTINGS.feather_px))
    return slice(max(rows[0] - reach, 0), rows[-1] + 1 + reach), slice(
        max(columns[0] - reach, 0), columns[-1] + 1 + reach
    )
