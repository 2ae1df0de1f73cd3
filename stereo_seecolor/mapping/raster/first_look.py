"""A first picture of a map that is being made: the coarse points of every frame from above, at the first estimate of its pose."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.geometry import transformed
from stereo_seecolor.mapping.frame_index import SAMPLING, FrameIndex
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.survey import Placement


@dataclass(frozen=True)
class LookSettings:
    """How coarse a picture is enough."""

    cell_m: float = SAMPLING.spacing_m / 2  # several frames show each place, each with other points
    most_px: int = 2000  # of its longer side: a screen
    fill_px: int = 5  # width of the window whose mean fills a cell without points
    frames_at_once: int = 64  # whose points are added up together


SETTINGS = LookSettings()


def first_look(index: FrameIndex, placement: Placement) -> NDArray[np.uint8] | None:
    """Draw the largest component from above, north up: (H, W, 4) RGBA, the mean color of the points over each cell; None without
    points.
    """
    frames = [int(i) for i in placement.frames_of(0) if len(index.points_m[i])]
    if not frames:
        return None
    boxes = [(points.min(axis=0), points.max(axis=0)) for points, _ in _placed(index, placement, frames)]
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    cell_m = max(SETTINGS.cell_m, float((high - low)[:2].max()) / SETTINGS.most_px)
    grid = Grid.around(low, high, cell_m)
    sums = np.zeros((4, grid.shape[0] * grid.shape[1]), np.float32)
    for start in range(0, len(frames), SETTINGS.frames_at_once):
        parts = list(_placed(index, placement, frames[start : start + SETTINGS.frames_at_once]))
        column, row = np.rint(grid.pixels(np.concatenate([points for points, _ in parts]))).astype(np.int64).T
        cells, colors = row * grid.shape[1] + column, np.concatenate([colors for _, colors in parts])
        sums[3] += np.bincount(cells, minlength=sums.shape[1])
        for channel in range(3):
            sums[channel] += np.bincount(cells, colors[:, channel], sums.shape[1])
    return _picture(np.moveaxis(sums.reshape(4, *grid.shape), 0, -1))


def _placed(index: FrameIndex, placement: Placement, frames: list[int]) -> Iterator[tuple[NDArray[np.float64], NDArray[np.uint8]]]:
    """Of each frame its points in the world, and their colors."""
    return ((transformed(placement.T_world_camera[i], index.points_m[i]), index.colors[i]) for i in frames)


def _picture(sums: NDArray[np.float32]) -> NDArray[np.uint8]:
    """sums: (H, W, 4) of red, green and blue, and how many points there were."""
    around = cv2.blur(sums, (SETTINGS.fill_px, SETTINGS.fill_px))
    filled = np.where(sums[..., 3:] > 0, sums, around)
    count = filled[..., 3:]
    colors = np.rint(filled[..., :3] / np.where(count > 0, count, 1))
    return np.concatenate([colors, np.where(count > 0, 255, 0)], axis=-1).astype(np.uint8)
