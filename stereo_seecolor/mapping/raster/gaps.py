"""Gaps of a map: cells without a height between cells that have one, and why they have none."""

from enum import IntEnum
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.transforms import inverse
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.surface.kernels import NEAREST_DEPTH_M, in_camera
from stereo_seecolor.mapping.survey_frames import Unplaced
from stereo_seecolor.records import Array, Map, SurveyFrame


class Reason(IntEnum):
    """Why a cell of a gap has no height; 0 where it has one, or lies outside of the map."""

    NOT_SEEN = 1
    """No image shows it: none reaches it, or something stands before it in all that do."""
    NO_RANGE = 2
    """Images show it, but have no range there."""
    UNCERTAIN = 3
    """Ranges were measured there, too uncertain for a surface: at a grazing angle, or from afar."""
    DISAGREE = 4
    """An image measured something there, and another looks through: it moved, or is wrong."""


MISSING_FRACTION = 0.25
"""Of the measured ground: more that has no height is a problem of a map. Voxels that fit the ranges
leave at most 0.04.
"""
WIDEST_M = 1.0
"""From a gap's cell to known ones on three of four sides: what is wider was not surveyed."""
SIDES = 3
CLOSED = 0.5
"""Of the cells around: so many known ones close a cell, as the mosaic does."""
SAMPLES = 9
"""Heights that are tried in a cell, from the lowest of what is known beside it to the highest"""
ABOVE_M = 0.3
"""and so much above it: what moves stands up from the bottom."""
SAME_RANGE = 0.02
"""An image measured a place whose distance is its range within this fraction, and"""
SAME_VOXELS = 2.0
"""no less than so many voxels: as where images are laid on the surface."""
KEPT_FRAMES = 32
"""Ranges in memory, 4 bytes a pixel: neighboring blocks share them."""
HIT, THROUGH, BLANK = 1, 2, 4
"""Bits of a height in a cell: an image measured it, looks through it, shows it without a range."""


def render_gaps(
    component: Component, terrain: BlockRaster, voxel_m: float, folder: Path
) -> BlockRaster:
    """Find the gaps of a component's terrain: (1, H, W) uint8, a Reason or 0.

    folder: where its blocks are written. Raises OutputError if the disk is full.
    """
    gaps, ranges = BlockRaster(folder, terrain.grid, 1, np.uint8, 0), _Ranges(component)
    windows = list(terrain.windows())
    for done, (rows, columns) in enumerate(windows, 1):
        places, points = gap_cells(terrain, rows, columns)
        if len(places):
            codes = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.uint8)
            codes[places[:, 0], places[:, 1]] = _reasons(points, ranges, SAME_VOXELS * voxel_m)
            gaps.write(rows, columns, codes[None])
        component.survey.progress(f"explaining gaps{component.label}", done, len(windows))
    return gaps


def gap_cells(terrain: BlockRaster, rows: slice, columns: slice) -> tuple[NDArray[np.int64], Array]:
    """The cells of the gaps in a window: row and column in it (n, 2), and x, y, and the lowest and
    the highest height where their surface may be (n, 4).
    """
    margin = round(WIDEST_M / terrain.grid.cell_m)
    heights = terrain.read(
        slice(rows.start - margin, rows.stop + margin),
        slice(columns.start - margin, columns.stop + margin),
    )[0]
    inner = np.s_[margin : heights.shape[0] - margin, margin : heights.shape[1] - margin]
    known = np.isfinite(heights)
    closed = cv2.blur(known.astype(np.float32), (3, 3)) >= CLOSED
    beside = np.stack(
        [
            _beside(heights, margin),
            _beside(heights[:, ::-1], margin)[:, ::-1],
            _beside(heights.T, margin).T,
            _beside(heights.T[:, ::-1], margin)[:, ::-1].T,
        ]
    )[:, *inner]
    open_cells = ~(known | closed)[inner] & (np.isfinite(beside).sum(axis=0) >= SIDES)
    places = np.argwhere(open_cells)
    around = beside[:, places[:, 0], places[:, 1]]
    x_m, y_m = terrain.grid.axes(rows, columns)
    low_m, high_m = np.fmin.reduce(around), np.fmax.reduce(around) + ABOVE_M
    return places, np.column_stack([x_m[places[:, 1]], y_m[places[:, 0]], low_m, high_m])


def _beside(heights: Map, most: int) -> Map:
    """(H, W) the height of the nearest known cell to the left, at most so many cells away; NaN
    where there is none.
    """
    column = np.arange(heights.shape[1])
    last = np.maximum.accumulate(np.where(np.isfinite(heights), column, -1), axis=1)
    found = np.take_along_axis(heights, np.maximum(last, 0), axis=1)
    return np.where((last >= 0) & (column - last <= most), found, np.float32(np.nan))


class _Ranges:
    """The ranges of a component's frames; those that were read last are kept."""

    def __init__(self, component: Component) -> None:
        survey = component.survey
        self.component, self.geometry = component, survey.geometry
        frames = survey.frames  # not of self, which would then hold itself in memory
        self.read = lru_cache(KEPT_FRAMES)(lambda number: _range_m(frames[number]))
        numbers = [int(i) for i in component.frames if len(survey.index.points_m[i])]
        self._numbers = np.array(numbers, np.int64)
        self._reach_m = np.array(
            [np.linalg.norm(survey.index.points_m[i], axis=1).max() for i in numbers]
        )

    def near(self, points: Array) -> list[int]:
        """The frames whose farthest measurement reaches a box around cells (n, 4)."""
        low, high = points[:, [0, 1, 2]].min(axis=0), points[:, [0, 1, 3]].max(axis=0)
        eye = self.component.T_local_camera[self._numbers, :3, 3]
        away_m = np.linalg.norm(np.maximum(np.maximum(low - eye, eye - high), 0), axis=1)
        return [int(i) for i in self._numbers[away_m <= self._reach_m * (1 + SAME_RANGE)]]


def _range_m(frame: SurveyFrame | Unplaced) -> Map | None:
    """None where the frame is lost."""
    return None if isinstance(frame, Unplaced) else frame.range_m


def _reasons(points: Array, ranges: _Ranges, least_m: float) -> NDArray[np.uint8]:
    """(n,) the reasons of cells (n, 4)."""
    g = ranges.geometry
    camera = np.array([g.focal_px, g.cx_left_px, g.cy_px])
    evidence = np.zeros((len(points), SAMPLES), np.uint8)
    for number in ranges.near(points):
        range_m = ranges.read(number)
        if range_m is None:
            continue
        T = inverse(ranges.component.T_local_camera[number])
        look_at(points, T, camera, range_m, np.array([SAME_RANGE, least_m]), evidence)
    return reasons_of(evidence)


def reasons_of(evidence: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(n,) reasons, of the bits of the heights that were tried in each cell (n, heights)."""
    hit, through, blank = ((evidence & bit) > 0 for bit in (HIT, THROUGH, BLANK))
    return np.select(
        [(hit & through).any(axis=1), hit.any(axis=1), blank.any(axis=1)],
        [Reason.DISAGREE, Reason.UNCERTAIN, Reason.NO_RANGE],
        Reason.NOT_SEEN,
    ).astype(np.uint8)


@compiled
def look_at(
    points: Any,  # (n, 4) float64: x, y, lowest and highest height of cells
    T: Any,  # (4, 4) float64, camera from map
    camera: Any,  # (3,) float64: focal_px, cx, cy
    range_m: Any,  # (H, W) float32
    same: Any,  # (2,) float64: ranges are the same within this fraction, and these meters
    evidence: Any,  # (n, heights) uint8: gets the bits of what the image shows
) -> None:
    """Note what an image shows of cells, at heights from the lowest to the highest."""
    height, width = range_m.shape
    count = evidence.shape[1]
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        for k in range(count):
            z = points[n, 2] + (points[n, 3] - points[n, 2]) * k / (count - 1)
            across, down, depth = in_camera(T, x, y, z)
            if not depth > NEAREST_DEPTH_M:
                continue
            u, v = camera[0] * across / depth + camera[1], camera[0] * down / depth + camera[2]
            if u < 0 or v < 0 or u > width - 1 or v > height - 1:
                continue
            away_m = np.sqrt(across * across + down * down + depth * depth)
            measured_m = range_m[np.uint64(v + 0.5), np.uint64(u + 0.5)]
            most_m = max(same[0] * away_m, same[1])
            if not measured_m > 0:
                evidence[n, k] |= BLANK
            elif abs(measured_m - away_m) <= most_m:
                evidence[n, k] |= HIT
            elif measured_m > away_m:
                evidence[n, k] |= THROUGH
