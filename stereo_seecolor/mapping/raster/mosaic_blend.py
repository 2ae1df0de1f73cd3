"""Views of an orthomosaic blended: each cell from its best view, in the coarse color of the mean of
all views, with soft seams.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

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


def blend(colors: NDArray[np.uint8], costs: Float, mean: Float) -> NDArray[np.uint8]:
    """Paint each cell from the view of least smoothed cost, in the color of the mean, with soft
    seams: (4, h, w) RGBA.

    Alpha is 0 where no view sees the cell. colors: (views, h, w, 3); costs: (views, h, w), infinite
    where a view does not see it.
    """
    seen = np.isfinite(costs)
    visible, best = seen.any(axis=0), _cheapest(costs, seen)
    total, sums = np.zeros(best.shape, np.float32), np.zeros((*best.shape, 3), np.float32)
    for k in range(len(colors)):
        mine = best == k
        window = _around(mine)
        if window is None:
            continue
        weight = (
            cv2.GaussianBlur(mine[window].astype(np.float32), (0, 0), SETTINGS.feather_px)
            * seen[k][window]
        )
        total[window] += weight
        sums[window] += weight[..., None] * _as_the_mean(colors[k], seen[k], mean, window)
    result = np.zeros((4, *best.shape), np.uint8)
    result[:3] = (
        np.clip(np.rint(sums / np.maximum(total, 1e-6)[..., None]), 0, 255)
        .astype(np.uint8)
        .transpose(2, 0, 1)
    )
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
    rows, columns = window
    top, left = max(rows.start - reach, 0), max(columns.start - reach, 0)
    # the blur at the window's edge reaches so far
    wide = (slice(top, rows.stop + reach), slice(left, columns.stop + reach))
    own, is_seen = color[wide].astype(np.float32), seen[wide][..., None]
    own_band, mean_band = _coarse_band(own * is_seen), _coarse_band(mean[wide] * is_seen)
    factor = np.clip(
        (mean_band + 1e-3) / (own_band + 1e-3), 1 / SETTINGS.most_change, SETTINGS.most_change
    )
    factor = cv2.resize(factor, own.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    inner = (
        slice(rows.start - top, rows.stop - top),
        slice(columns.start - left, columns.stop - left),
    )
    return np.asarray(own[inner] * factor[inner], np.float32)


def _coarse_band(color: Float) -> Float:
    """Blur colors (h, w, 3), reduced by SETTINGS.coarser along both axes."""
    height, width = color.shape[:2]
    size = max(width // SETTINGS.coarser, 1), max(height // SETTINGS.coarser, 1)
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    return np.asarray(
        cv2.GaussianBlur(small, (0, 0), SETTINGS.band_px / SETTINGS.coarser), np.float32
    )


def _cheapest(costs: Float, seen: NDArray[np.bool_]) -> NDArray[np.int16]:
    """Find for each cell the view whose cost, averaged over its neighborhood, is least: (h, w), -1
    where none sees the cell.
    """
    size, least = (SETTINGS.smooth_px,) * 2, np.full(costs.shape[1:], np.inf, np.float32)
    best = np.full(costs.shape[1:], -1, np.int16)
    for k in range(len(costs)):
        fraction = cv2.blur(seen[k].astype(np.float32), size)
        mean = cv2.blur(np.where(seen[k], costs[k], np.float32(0)), size) / np.maximum(
            fraction, 1e-6
        )
        better = seen[k] & (mean < least)
        least[better], best[better] = mean[better], k
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
