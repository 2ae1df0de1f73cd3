"""The orthomosaic: each cell of the terrain painted from its best view, seams where neighboring views agree."""

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.geometry import inverse, transformed
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.raster.block_raster import BLOCK_PX, BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.recovered_frames import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame

Float = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class MosaicSettings:
    """How views are chosen."""

    views_a_meter: int = 12  # frames that a block is painted from, for each meter of its edge: more never win
    repaints: int = 3  # so often views are chosen anew for what the first ones do not see,
    unpainted: float = 0.01  # where that is more than this fraction of the cells
    cached_frames: int = 16  # read frames that are kept, some 10 MB each: neighboring blocks share them
    smooth_px: int = 21  # costs are averaged over it, cells: seams run in straight stretches (Rhemann et al. 2011)
    feather_px: float = 2.0  # standard deviation of the blend across a seam, cells
    disagreement: float = 4.0  # cost of a color a tenth of full scale off the median of all views, in tangents of the angle
    hidden_m: float = 0.05  # a view whose range is off by more than this,
    hidden_fraction: float = 0.02  # and this fraction of it, shows something else: it stands before the cell, or moved
    doubtful_cost: float = 1.0  # of a clipped or unrecoverable color: as of a view at 45 degrees


SETTINGS = MosaicSettings()


def render_mosaic(component: Component, terrain: BlockRaster, grid: Grid, folder: Path) -> BlockRaster:
    """RGBA (4, H, W) on ``grid``, alpha 0 where no view reaches."""
    survey = component.survey
    mosaic = BlockRaster(folder, grid, 4, np.uint8, 0)
    boxes = {int(i): _box(component.points_m(int(i))) for i in component.frames if len(survey.index.points_m[i])}
    cache = _Cache(survey.frames)
    windows = _windows(terrain, grid)
    for done, (rows, columns) in enumerate(windows):
        points = _points(terrain, grid, rows, columns)
        if np.isfinite(points[..., 2]).any():
            mosaic.write(rows, columns, _painted(points, boxes, component, cache))
        survey.progress(f"painting the mosaic{component.label}", done + 1, len(windows))
    return mosaic


def _painted(points: Array, boxes: dict[int, tuple[Array, Array]], component: Component, cache: "_Cache") -> NDArray[np.uint8]:
    """(4, h, w): by the views nearest to the block's middle, then what those do not see by the views nearest to it."""
    painted = np.zeros((4, *points.shape[:2]), np.uint8)
    known = np.isfinite(points[..., 2])
    left = known
    for _ in range(SETTINGS.repaints):
        reaching = _reaching(points, left, boxes, component.T_local_camera)
        views = [(frame, component.T_local_camera[i]) for i, frame in zip(reaching, cache.read(reaching), strict=True)]
        painted[:, left] = _paint(points, views, component.survey.geometry)[:, left]
        boxes = {i: box for i, box in boxes.items() if i not in reaching}
        left = known & (painted[3] == 0)
        if left.sum() <= SETTINGS.unpainted * known.sum():
            break
    return painted


class _Cache:
    """The frames read last."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._held: OrderedDict[int, SurveyFrame | Unplaced] = OrderedDict()

    def read(self, wanted: list[int]) -> list[SurveyFrame | Unplaced]:
        """These frames, those not held on all cores; the ones asked for last are held on to."""
        missing = [i for i in wanted if i not in self._held]
        self._held.update(zip(missing, core_pool().map(self._frames.__getitem__, missing), strict=True))
        for i in wanted:
            self._held.move_to_end(i)
        found = [self._held[i] for i in wanted]
        while len(self._held) > SETTINGS.cached_frames:
            self._held.popitem(last=False)
        return found


def _box(points_m: Array) -> tuple[Array, Array]:
    return points_m[:, :2].min(axis=0), points_m[:, :2].max(axis=0)


def _windows(terrain: BlockRaster, grid: Grid) -> list[tuple[slice, slice]]:
    """The mosaic's blocks that lie over blocks of the terrain, row by row."""
    blocks = set()
    for rows, columns in terrain.windows():
        x, y = terrain.grid.centers(rows, columns)
        corners = grid.pixels(np.array([[x[0, 0], y[0, 0]], [x[-1, -1], y[-1, -1]]]))
        first, last = np.floor((corners - 1) / BLOCK_PX).astype(int), np.floor((corners + 1) / BLOCK_PX).astype(int)
        for row in range(max(first[0, 1], 0), last[1, 1] + 1):
            blocks |= {(row, column) for column in range(max(first[0, 0], 0), last[1, 0] + 1)}
    sides = [(slice(r * BLOCK_PX, (r + 1) * BLOCK_PX), slice(c * BLOCK_PX, (c + 1) * BLOCK_PX)) for r, c in sorted(blocks)]
    height, width = grid.shape
    return [
        (slice(rows.start, min(rows.stop, height)), slice(columns.start, min(columns.stop, width)))
        for rows, columns in sides
        if rows.start < height and columns.start < width
    ]


def _points(terrain: BlockRaster, grid: Grid, rows: slice, columns: slice) -> Array:
    """(h, w, 3) of the cells of a window, heights interpolated in the terrain; NaN where it is unknown."""
    x, y = grid.centers(rows, columns)
    pixels = terrain.grid.pixels(np.stack([x.ravel(), y.ravel()], axis=-1)).reshape(*x.shape, 2)
    low = np.floor(pixels.min(axis=(0, 1))).astype(int) - 1
    high = np.ceil(pixels.max(axis=(0, 1))).astype(int) + 2
    part = terrain.read(slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0])))[0]
    known = np.isfinite(part).astype(np.float32)
    local = (pixels - low).astype(np.float32)
    weight = cv2.remap(known, local, None, cv2.INTER_LINEAR)
    z = cv2.remap(np.nan_to_num(part), local, None, cv2.INTER_LINEAR)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([x, y, np.where(weight > 0.5, z / weight, np.nan)], axis=-1)


def _reaching(points: Array, wanted: NDArray[np.bool_], boxes: dict[int, tuple[Array, Array]], T: Array) -> list[int]:
    """The frames that see part of the wanted cells, those right above their middle first, no more than are of use."""
    low, high = points[wanted][:, :2].min(axis=0), points[wanted][:, :2].max(axis=0)
    middle = (low + high) / 2
    near = [i for i, box in boxes.items() if (box[0] <= high).all() and (box[1] >= low).all()]
    side = max(1, int(np.ceil(float((high - low).max()))))
    return sorted(sorted(near, key=lambda i: (float(np.hypot(*(T[i, :2, 3] - middle))), i))[: SETTINGS.views_a_meter * side])


def _paint(points: Array, views: list[tuple[SurveyFrame | Unplaced, Array]], geometry: RectifiedPair) -> NDArray[np.uint8]:
    """Choose for each cell the view of least cost, after smoothing the costs (Rhemann et al. 2011), and soften the seams.

    A view costs the tangent of its angle from the vertical, more where its color is doubtful, and more where its color differs
    from the median of all views: fish, shadows and badly placed frames lose there, and seams move to where views agree.
    """
    readable = [(frame, T) for frame, T in views if isinstance(frame, SurveyFrame)]
    tried = core_pool().map(lambda view: _view(points, view[0], view[1], geometry), readable)
    found = [view for view in tried if view is not None]
    if not found:
        return np.zeros((4, *points.shape[:2]), np.uint8)
    colors, costs = np.stack([view[0] for view in found]), np.stack([view[1] for view in found])
    seen = np.isfinite(costs)
    if len(found) > 2:
        with np.errstate(invalid="ignore"):
            off = np.abs(colors - _masked_median(colors, seen))
        costs = costs + np.float32(SETTINGS.disagreement / 3 / 25.5) * (off[..., 0] + off[..., 1] + off[..., 2])
    return _blend(colors, _smoothed(costs, seen).argmin(axis=0), seen)


def _smoothed(costs: Float, seen: NDArray[np.bool_]) -> Float:
    """Costs (views, h, w) averaged over their neighborhood, infinite where a view does not see the cell."""
    size, smooth = (SETTINGS.smooth_px,) * 2, np.empty_like(costs)
    for k in range(len(costs)):
        fraction = cv2.blur(seen[k].astype(np.float32), size)
        mean = cv2.blur(np.where(seen[k], costs[k], 0).astype(np.float32), size) / np.maximum(fraction, 1e-6)
        smooth[k] = np.where(seen[k], mean, np.inf)
    return smooth


def _blend(colors: Float, best: NDArray[np.int64], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(4, h, w): the best view's color, softened across the seams; alpha 0 where none sees the cell."""
    total = np.zeros(best.shape, np.float32)
    blend = np.zeros((*best.shape, 3), np.float32)
    for k in range(len(colors)):
        weight = cv2.GaussianBlur((best == k).astype(np.float32), (0, 0), SETTINGS.feather_px) * seen[k]
        total += weight
        blend += weight[..., None] * colors[k]
    visible = seen.any(axis=0)
    result = np.zeros((4, *best.shape), np.uint8)
    result[:3] = np.clip(np.rint(blend / np.maximum(total, 1e-6)[..., None]), 0, 255).astype(np.uint8).transpose(2, 0, 1)
    result[3] = np.where(visible, 255, 0)
    result[:3, ~visible] = 0
    return result


def _view(points: Array, frame: SurveyFrame, T_local_camera: Array, geometry: RectifiedPair) -> tuple[Float, Float] | None:
    """Colors (h, w, 3) that a frame has for the cells, and what each costs, infinite where it does not see the cell."""
    local = transformed(inverse(T_local_camera), points)
    with np.errstate(invalid="ignore", divide="ignore"):
        u = (geometry.focal_px * local[..., 0] / local[..., 2] + geometry.cx_left_px).astype(np.float32)
        v = (geometry.focal_px * local[..., 1] / local[..., 2] + geometry.cy_px).astype(np.float32)
        width, height = geometry.image_size
        inside = (local[..., 2] > 0.05) & (u >= 1) & (v >= 1) & (u <= width - 2) & (v <= height - 2)
    if not inside.any():
        return None
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    color = cv2.remap(frame.color, u, v, cv2.INTER_LINEAR).astype(np.float32)
    measured = cv2.remap(frame.range_m, u, v, cv2.INTER_NEAREST)
    # Where the range is unknown the frame may be painted black: such a pixel must not bleed into its neighbors.
    whole = cv2.remap(np.isfinite(frame.range_m).astype(np.float32), u, v, cv2.INTER_LINEAR) > 0.999
    distance = np.sqrt(local[..., 0] ** 2 + local[..., 1] ** 2 + local[..., 2] ** 2)
    with np.errstate(invalid="ignore"):
        hidden = (
            np.abs(measured - distance) > SETTINGS.hidden_m + SETTINGS.hidden_fraction * distance
        )  # something stands before it, or it moved
        seen = inside & ~hidden & whole
        offset = points - T_local_camera[:3, 3]
        cost = np.hypot(offset[..., 0], offset[..., 1]) / np.maximum(-offset[..., 2], 0.05)
    cost += SETTINGS.doubtful_cost * cv2.remap(frame.color_is_doubtful.view(np.uint8), u, v, cv2.INTER_NEAREST)
    return color, np.where(seen, cost, np.inf).astype(np.float32)


def _masked_median(colors: Float, seen: NDArray[np.bool_]) -> Float:
    """(h, w, 3) median over the views that see a cell; 0 where none does."""
    count = seen.sum(axis=0)
    ordered = np.sort(np.where(seen[..., None], colors, np.inf), axis=0)
    low, high = np.maximum((count - 1) // 2, 0), np.maximum(count // 2, 0)
    pick = [np.take_along_axis(ordered, np.minimum(n, len(colors) - 1)[None, :, :, None], axis=0)[0] for n in (low, high)]
    return np.where(count[..., None] > 0, (pick[0] + pick[1]) / 2, 0).astype(np.float32)
