"""The orthomosaic: each cell's detail comes from its best view, its coarse color from the mean of
all views that see it.

Seams between views are placed where neighboring views agree.
"""

from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.transforms import inverse
from stereo_seecolor.compute.threads import Lock, Threads, core_pool, in_parts
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.raster.block_raster import BLOCK_PX, BlockRaster, block_windows
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.mosaic_blend import SeenCells, blend
from stereo_seecolor.mapping.raster.mosaic_kernels import agree, see
from stereo_seecolor.mapping.survey_frames import Frames, Unplaced
from stereo_seecolor.records import Array

Float = NDArray[np.float32]


@dataclass(frozen=True)
class MosaicSettings:
    """How views are chosen."""

    # frames that a block is painted from, for each meter of its edge: more never win
    views_a_meter: int = 12
    # rounds of painting: each chooses views for what those before it did not see,
    repaints: int = 3
    unpainted: float = 0.01  # as long as that is more than this fraction of the cells
    # one is blended while the cells of the other are looked up on all cores
    windows_at_once: int = 2
    # read frames that are kept, 8 bytes a pixel: neighboring blocks share them
    cached_frames: int = 16
    # cost of a color a tenth of full scale off the median of all views, in tangents of the angle
    disagreement: float = 4.0
    # of 255: a color so far off the median of all views, a tenth of full scale, weighs half in
    # their mean
    outlier: float = 25.5
    # fraction of a cell of the terrain and its eight neighbors that must be known for it to be
    # painted
    closed: float = 0.5
    hidden_m: float = 0.05  # a view whose range is off by more than this,
    # and this fraction of it, shows something else: it stands before the cell, or moved
    hidden_fraction: float = 0.02
    doubtful_cost: float = 1.0  # of a clipped or unrecoverable color: as of a view at 45 degrees


SETTINGS = MosaicSettings()


@dataclass(frozen=True, eq=False)
class Cells:
    """A window of the mosaic. edge_m: of a cell. x_m: (w,), y_m: (h,) centers. z_m: (h, w) heights,
    NaN where unknown.

    other_m: (h, w) the height beyond the step for a cell at a step of the terrain, else NaN.
    """

    edge_m: float
    x_m: Array
    y_m: Array
    z_m: Array
    other_m: Array


def render_mosaic(
    component: Component, terrain: BlockRaster, grid: Grid, folder: Path
) -> BlockRaster:
    """Paint the mosaic of a component on ``grid``: RGBA (4, H, W) uint8, alpha 0 where no view sees
    the ground.

    folder: where its blocks are written. Raises OutputError if the disk is full.
    """
    survey = component.survey
    mosaic = BlockRaster(folder, grid, 4, np.uint8, 0)
    boxes = {
        int(i): _box(component.points_m(int(i)))
        for i in component.frames
        if len(survey.index.points_m[i])
    }
    cache = _Cache(survey.frames)
    windows = _windows(terrain, grid)

    def paint(window: tuple[slice, slice]) -> None:
        cells = _cells(terrain, grid, *window)
        if np.isfinite(cells.z_m).any():
            mosaic.write(*window, _painted(cells, boxes, component, cache))

    for done, _ in enumerate(Threads(SETTINGS.windows_at_once).each(paint, windows), 1):
        survey.progress(f"painting the mosaic{component.label}", done, len(windows))
    return mosaic


def _painted(
    cells: Cells, boxes: dict[int, tuple[Array, Array]], component: Component, cache: "_Cache"
) -> NDArray[np.uint8]:
    """Paint a window, (4, h, w): by the views nearest to its middle, then what those do not see by
    the views nearest to that.
    """
    known = np.isfinite(cells.z_m)
    painted, left = np.zeros((4, *known.shape), np.uint8), known
    for _ in range(SETTINGS.repaints):
        reaching = _reaching(cells, left, boxes, component.T_local_camera)
        views = [
            (sight, component.T_local_camera[i])
            for i, sight in zip(reaching, cache.read(reaching), strict=True)
            if sight
        ]
        painted[:, left] = _paint(cells, views, component.survey.geometry)[:, left]
        boxes = {i: box for i, box in boxes.items() if i not in reaching}
        left = known & (painted[3] == 0)
        if left.sum() <= SETTINGS.unpainted * known.sum():
            break
    return painted


@dataclass(frozen=True, eq=False)
class _Sight:
    """The parts of a SurveyFrame that a mosaic is painted from."""

    color: NDArray[np.uint8]
    range_m: Float
    doubtful: NDArray[np.bool_]


class _Cache:
    """The frames that were read last; safe for several threads."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._held: OrderedDict[int, _Sight | None] = OrderedDict()
        self._reading = Lock()

    def read(self, wanted: list[int]) -> list[_Sight | None]:
        """Read these frames, on all cores, and keep the latest in memory; None for lost ones."""
        with self._reading:
            missing = [i for i in wanted if i not in self._held]
            self._held.update(zip(missing, core_pool().map(self._sight, missing), strict=True))
            for i in wanted:
                self._held.move_to_end(i)
            found = [self._held[i] for i in wanted]
            while len(self._held) > SETTINGS.cached_frames:
                self._held.popitem(last=False)
            return found

    def _sight(self, number: int) -> _Sight | None:
        frame = self._frames[number]
        return (
            None
            if isinstance(frame, Unplaced)
            else _Sight(frame.color, frame.range_m, frame.color_is_doubtful)
        )


def _box(points_m: Array) -> tuple[Array, Array]:
    return points_m[:, :2].min(axis=0), points_m[:, :2].max(axis=0)


def _windows(terrain: BlockRaster, grid: Grid) -> list[tuple[slice, slice]]:
    """The mosaic's blocks that lie over blocks of the terrain, row by row."""
    blocks = set()
    for rows, columns in terrain.windows():
        x, y = terrain.grid.centers(rows, columns)
        corners = grid.pixels(np.array([[x[0, 0], y[0, 0]], [x[-1, -1], y[-1, -1]]]))
        first = np.floor((corners - 1) / BLOCK_PX).astype(int)
        last = np.floor((corners + 1) / BLOCK_PX).astype(int)
        for row in range(max(first[0, 1], 0), last[1, 1] + 1):
            blocks |= {(row, column) for column in range(max(first[0, 0], 0), last[1, 0] + 1)}
    return list(block_windows(blocks, grid.shape))


def _cells(terrain: BlockRaster, grid: Grid, rows: slice, columns: slice) -> Cells:
    """The cells of a window, heights interpolated in the terrain."""
    x_m, y_m = grid.axes(rows, columns)
    across, down = terrain.grid.columns(x_m), terrain.grid.rows(y_m)
    left, top = int(np.floor(across[0])) - 2, int(np.floor(down[0])) - 2
    part = _closed(
        terrain.read(
            slice(top, int(np.ceil(down[-1])) + 3), slice(left, int(np.ceil(across[-1])) + 3)
        )[0]
    )
    u, v = np.meshgrid((across - left).astype(np.float32), (down - top).astype(np.float32))
    weight = cv2.remap(np.isfinite(part).astype(np.float32), u, v, cv2.INTER_LINEAR)
    z = cv2.remap(np.nan_to_num(part), u, v, cv2.INTER_LINEAR)
    lowest, highest = (
        cv2.remap(heights, u, v, cv2.INTER_NEAREST) for heights in _around_each(part)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        z_m = np.where(weight > 0.5, z / weight, np.nan).astype(np.float64)
        at_step = (weight > 0.5) & (highest - lowest > SETTINGS.hidden_m)
        z_m[at_step] = _on_one_side(part, u[at_step], v[at_step])
        other_m = np.where(z_m - lowest > highest - z_m, lowest, highest)
    return Cells(grid.cell_m, x_m, y_m, z_m, np.where(at_step, other_m, np.nan).astype(np.float64))


def _on_one_side(terrain_m: Float, u: Float, v: Float) -> Float:
    """Interpolate heights, (n,), at columns u and rows v of the terrain, bilinearly, from cells on
    one side of a step only.

    Between cells on both sides of a step, those of the side that weighs more are taken. So the
    step's edge crosses the terrain's cells, and does not run along their borders.
    """
    column, row = u.astype(int), v.astype(int)
    corners = np.stack([terrain_m[row + j, column + i] for j in (0, 1) for i in (0, 1)])
    right, below = u - column, v - row
    weights = np.stack(
        [(1 - right) * (1 - below), right * (1 - below), (1 - right) * below, right * below]
    )
    weights *= np.isfinite(corners)
    highest, lowest = np.fmax.reduce(corners), np.fmin.reduce(corners)
    upper = weights * (corners > (highest + lowest) / 2)
    side = np.where(upper.sum(axis=0) > 0.5 * weights.sum(axis=0), upper, weights - upper)
    weights = np.where(highest - lowest > SETTINGS.hidden_m, side, weights)
    return np.asarray((weights * np.nan_to_num(corners)).sum(axis=0) / weights.sum(axis=0))


def _closed(heights_m: Float) -> Float:
    """Fill unknown cells of which most neighbors are known, at their mean height: a view that
    measured that range paints them.
    """
    known, window = np.isfinite(heights_m), (3, 3)
    fraction = cv2.blur(known.astype(np.float32), window)
    mean = cv2.blur(np.nan_to_num(heights_m), window) / np.maximum(fraction, np.float32(1e-6))
    return np.asarray(np.where(known | (fraction < SETTINGS.closed), heights_m, mean), np.float32)


def _around_each(heights_m: Float) -> tuple[Float, Float]:
    """The lowest and highest of each cell and its eight neighbors; infinite if unknown."""
    known, around = np.isfinite(heights_m), np.ones((3, 3), np.uint8)
    lowest = cv2.erode(np.where(known, heights_m, np.inf).astype(np.float32), around)
    return lowest, cv2.dilate(np.where(known, heights_m, -np.inf).astype(np.float32), around)


def _reaching(
    cells: Cells, wanted: NDArray[np.bool_], boxes: dict[int, tuple[Array, Array]], T: Array
) -> list[int]:
    """The frames that see part of the wanted cells, those right above their middle first, no more
    than are of use.
    """
    x_m, y_m = cells.x_m[wanted.any(axis=0)], cells.y_m[wanted.any(axis=1)]
    low, high = np.array([x_m.min(), y_m.min()]), np.array([x_m.max(), y_m.max()])
    middle = (low + high) / 2
    near = [i for i, box in boxes.items() if (box[0] <= high).all() and (box[1] >= low).all()]
    most = int(np.ceil(SETTINGS.views_a_meter * max(1.0, float((high - low).max()))))
    return sorted(sorted(near, key=lambda i: (float(np.hypot(*(T[i, :2, 3] - middle))), i))[:most])


def _paint(
    cells: Cells, views: list[tuple[_Sight, Array]], geometry: RectifiedPair
) -> NDArray[np.uint8]:
    """Choose for each cell the view of least cost, after smoothing the costs (Rhemann et al. 2011),
    and soften the seams.

    A view costs the tangent of its angle from the vertical, more where its color is doubtful, and
    more where its color differs from the median of all views: fish, shadows and badly placed frames
    lose there, and seams move to where views agree.
    """
    found = [one for one in core_pool().map(partial(_seen, cells, geometry), views) if one]
    if not found:
        return np.zeros((4, *cells.z_m.shape), np.uint8)
    return blend(*_compared(found, cells.z_m.shape))


def _seen(
    cells: Cells, geometry: RectifiedPair, view: tuple[_Sight, Array]
) -> tuple[SeenCells, Float] | None:
    """What a frame sees of the cells, and its weight (h, w) in the mean of all; or None."""
    sight, T_local_camera = view
    shape = cells.z_m.shape
    color = np.zeros((*shape, 3), np.uint8)
    cost = np.empty(shape, np.float32)
    weight = np.zeros(shape, np.float32)
    camera = np.array([geometry.focal_px, geometry.cx_left_px, geometry.cy_px])
    limits = np.array(
        [
            SETTINGS.hidden_m,
            SETTINGS.hidden_fraction,
            SETTINGS.doubtful_cost,
            cells.edge_m,
        ]
    )
    count = see(
        cells.x_m, cells.y_m, cells.z_m, cells.other_m, inverse(T_local_camera),
        np.ascontiguousarray(T_local_camera[:3, 3]),
        camera, sight.color, sight.range_m, sight.doubtful, limits, color, cost, weight,
    )  # fmt: skip
    if not count:
        return None
    known = np.isfinite(cost)
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return SeenCells(part, color[part].copy(), cost[part].copy()), weight[part].copy()


def _compared(
    found: list[tuple[SeenCells, Float]], shape: tuple[int, int]
) -> tuple[list[SeenCells], Float]:
    """The views with costs that grow with the distance of their colors from the median of all
    views, and the mean color (H, W, 3) of all. found: what ``_seen`` found, and is emptied, as it
    is much of the memory.
    """
    parts = [view.part for view, _ in found]
    color = np.concatenate([view.color.reshape(-1, 3) for view, _ in found])
    cost = np.concatenate([view.cost.ravel() for view, _ in found])
    weight = np.concatenate([own.ravel() for _, own in found])
    found.clear()
    boxes = np.array([(r.start, r.stop, c.start, c.stop) for r, c in parts], np.int64)
    sizes = boxes[:, 1::2] - boxes[:, ::2]
    ends = np.cumsum(sizes.prod(axis=1))
    boxes = np.column_stack([boxes, ends - sizes.prod(axis=1)])
    mean = np.zeros((*shape, 3), np.float32)
    cost_a_level = SETTINGS.disagreement / 3 / 25.5
    outlier = SETTINGS.outlier
    in_parts(partial(agree, boxes, color, cost, weight, cost_a_level, outlier, mean), len(mean))
    views = [
        SeenCells(part, own_color.reshape(*size, 3), own_cost.reshape(size))
        for part, size, own_color, own_cost in zip(
            parts, sizes, np.split(color, ends[:-1]), np.split(cost, ends[:-1]), strict=True
        )
    ]
    return views, mean
