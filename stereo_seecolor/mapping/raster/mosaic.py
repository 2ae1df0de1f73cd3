"""The orthomosaic: each cell of the terrain painted from its best view, seams where neighboring views agree."""

from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.geometry import inverse
from stereo_seecolor.mapping.frame_index import FrameIndex, Progress, silent
from stereo_seecolor.mapping.raster.block_raster import BLOCK_PX, BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.recovered import Frames, Unplaced
from stereo_seecolor.records import SurveyFrame

MAX_VIEWS = 12
CACHED_FRAMES = 16
SMOOTH_PX = 21
FEATHER_PX = 2.0
DISAGREEMENT = 4.0
"""What a color one tenth of full scale away from the median of all views costs, in tangents of the angle from the vertical."""
HIDDEN_M = 0.05
DOUBTFUL_COST = 1.0

Float = NDArray[np.float32]


def render_mosaic(
    frames: Frames,
    pair: RectifiedPair,
    index: FrameIndex,
    T_world_camera: NDArray[np.float64],
    chosen: NDArray[np.int64],
    terrain: BlockRaster,
    grid: Grid,
    folder: Path,
    progress: Progress = silent,
) -> BlockRaster:
    """RGBA (4, H, W) on ``grid``, alpha 0 where no view reaches."""
    mosaic = BlockRaster(folder, grid, 4, np.uint8, 0)
    boxes = {int(i): _box(index.points_m[i], T_world_camera[i]) for i in chosen if len(index.points_m[i])}
    cache = _Cache(frames)
    windows = _windows(terrain, grid)
    for done, (rows, columns) in enumerate(windows):
        points = _points(terrain, grid, rows, columns)
        if np.isfinite(points[..., 2]).any():
            reaching = _reaching(points, boxes, T_world_camera)
            mosaic.write(rows, columns, _paint(points, reaching, cache, pair, T_world_camera))
        progress("painting the mosaic", done + 1, len(windows))
    return mosaic


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
        while len(self._held) > CACHED_FRAMES:
            self._held.popitem(last=False)
        return found


def _box(points_m: NDArray[np.float32], T: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    world = points_m @ T[:2, :3].T + T[:2, 3]
    return world.min(axis=0), world.max(axis=0)


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


def _points(terrain: BlockRaster, grid: Grid, rows: slice, columns: slice) -> NDArray[np.float64]:
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


def _reaching(
    points: NDArray[np.float64], boxes: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]], T: NDArray[np.float64]
) -> list[int]:
    """The frames that see part of the block, those right above its middle first, no more than are of use."""
    low, high = points[..., :2].min(axis=(0, 1)), points[..., :2].max(axis=(0, 1))
    middle = (low + high) / 2
    near = [i for i, box in boxes.items() if (box[0] <= high).all() and (box[1] >= low).all()]
    side = max(1, int(np.ceil(float((high - low).max()))))
    return sorted(sorted(near, key=lambda i: (float(np.hypot(*(T[i, :2, 3] - middle))), i))[: MAX_VIEWS * side])


def _paint(
    points: NDArray[np.float64], views: list[int], cache: _Cache, pair: RectifiedPair, T_world_camera: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Choose for each cell the view of least cost, after smoothing the costs (Rhemann et al. 2011), and soften the seams.

    A view costs the tangent of its angle from the vertical, more where its color is doubtful, and more where its color differs
    from the median of all views: fish, shadows and badly placed frames lose there, and seams move to where views agree.
    """
    result = np.zeros((4, *points.shape[:2]), np.uint8)
    readable = [(i, frame) for i, frame in zip(views, cache.read(views), strict=True) if isinstance(frame, SurveyFrame)]
    tried = core_pool().map(lambda view: _look(points, view[1], pair, T_world_camera[view[0]]), readable)
    looks = [look for look in tried if look is not None]
    if not looks:
        return result
    colors, costs = np.stack([look[0] for look in looks]), np.stack([look[1] for look in looks])
    seen = np.isfinite(costs)
    if len(looks) > 2:
        with np.errstate(invalid="ignore"):
            median = _masked_median(colors, seen)
        off = np.abs(colors - median)
        costs = costs + np.float32(DISAGREEMENT / 3 / 25.5) * (off[..., 0] + off[..., 1] + off[..., 2])
    for k in range(len(looks)):
        share = cv2.blur(seen[k].astype(np.float32), (SMOOTH_PX, SMOOTH_PX))
        smooth = cv2.blur(np.where(seen[k], costs[k], 0).astype(np.float32), (SMOOTH_PX, SMOOTH_PX)) / np.maximum(share, 1e-6)
        costs[k] = np.where(seen[k], smooth, np.inf)
    best = costs.argmin(axis=0)
    total = np.zeros(points.shape[:2], np.float32)
    blend = np.zeros((*points.shape[:2], 3), np.float32)
    for k in range(len(looks)):
        weight = cv2.GaussianBlur((best == k).astype(np.float32), (0, 0), FEATHER_PX) * seen[k]
        total += weight
        blend += weight[..., None] * colors[k]
    visible = seen.any(axis=0)
    result[:3] = np.clip(np.rint(blend / np.maximum(total, 1e-6)[..., None]), 0, 255).astype(np.uint8).transpose(2, 0, 1)
    result[3] = np.where(visible, 255, 0)
    result[:3, ~visible] = 0
    return result


def _look(
    points: NDArray[np.float64], frame: SurveyFrame, pair: RectifiedPair, T_world_camera: NDArray[np.float64]
) -> tuple[Float, Float] | None:
    """Colors (h, w, 3) that a frame has for the cells, and what each costs, infinite where it does not see the cell."""
    T = inverse(T_world_camera)
    local = points @ T[:3, :3].T + T[:3, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        u = (pair.focal_px * local[..., 0] / local[..., 2] + pair.cx_left_px).astype(np.float32)
        v = (pair.focal_px * local[..., 1] / local[..., 2] + pair.cy_px).astype(np.float32)
        width, height = pair.image_size
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
        hidden = np.abs(measured - distance) > HIDDEN_M + 0.02 * distance  # something stands before it, or it moved
        seen = inside & ~hidden & whole
        offset = points - T_world_camera[:3, 3]
        cost = np.hypot(offset[..., 0], offset[..., 1]) / np.maximum(-offset[..., 2], 0.05)
    cost += DOUBTFUL_COST * cv2.remap(frame.color_is_doubtful.view(np.uint8), u, v, cv2.INTER_NEAREST)
    return color, np.where(seen, cost, np.inf).astype(np.float32)


def _masked_median(colors: Float, seen: NDArray[np.bool_]) -> Float:
    """(h, w, 3) median over the views that see a cell; 0 where none does."""
    count = seen.sum(axis=0)
    ordered = np.sort(np.where(seen[..., None], colors, np.inf), axis=0)
    low, high = np.maximum((count - 1) // 2, 0), np.maximum(count // 2, 0)
    pick = [np.take_along_axis(ordered, np.minimum(n, len(colors) - 1)[None, :, :, None], axis=0)[0] for n in (low, high)]
    return np.where(count[..., None] > 0, (pick[0] + pick[1]) / 2, 0).astype(np.float32)
