"""What frames see of a fused terrain, cell by cell, with the standard errors of their ranges.

Each frame's measured ranges are compared with the terrain along its own rays. A range error dr
moves the surface over a cell by dz = dr (r_z - p r_x - q r_y), r the ray and p, q the slopes.
Independent views weigh 1 / variance.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import inverse, transform_points
from stereo_seecolor.mapping.raster.grid import Grid, widened
from stereo_seecolor.records import Array, SurveyFrame
from stereo_seecolor.run_folder.posed_run import MATCH_PX, PosedRun
from stereo_seecolor.run_folder.survey_frames import SurveyFrames


@dataclass(frozen=True)
class ErrorSettings:
    """Which ranges count as a view of a cell."""

    # a range further off than this shows something else: a fish, a branch before the cell
    gate_sigmas: float = 6.0
    gate_voxels: float = 3.0  # and further than this, since voxels round off what is finer
    reach_step_px: int = 16  # of the pixels that show which cells a frame can see


SETTINGS = ErrorSettings()


def noise_of(weight: Array, known: NDArray[np.bool_]) -> Array:
    """(H, W) standard errors of heights by those of the ranges, from the summed weights of views
    (H, W); NaN where no view is, and where the height is not known (H, W).
    """
    seen = known & (weight > 0)
    return np.where(seen, 1 / np.sqrt(np.where(seen, weight, 1)), np.nan)


def correlation_of(footprints_m: Sequence[float], grid: Grid) -> float:
    """The distance over which errors of heights are alike, meters, from footprints of views."""
    return MATCH_PX * (float(np.median(footprints_m)) if footprints_m else grid.cell_m)


@dataclass(frozen=True, eq=False)
class CellsSeen:
    """What a frame sees of a terrain: a window of it, and for each cell whether it is seen, the
    weight of the view (1 / variance of the height) and by how much the height is off, meters; 0
    where it is not seen. footprint_m: of a pixel, NaN where nothing is seen.
    """

    window: tuple[slice, slice]
    seen: NDArray[np.bool_]
    weight: Array
    off_m: Array
    footprint_m: float


def views_of(
    posed: PosedRun,
    frames: SurveyFrames,
    grid: Grid,
    heights_of: Callable[[tuple[slice, slice]], Array],
    T_terrain_map: Array,
) -> Iterator[CellsSeen]:
    """What each frame of a map sees of a terrain, one after the other. heights_of: a window of the
    grid -> its heights. Raises InputError for a frame whose files are gone: heights without their
    noise seem rough.
    """
    for number, T_map_camera in enumerate(posed.T_map_camera):
        frame = frames[number]
        T = T_terrain_map @ T_map_camera
        window = _window(frame, grid, T, posed.geometry)
        if window is not None:
            wider, inner = widened(window, 1, 1, grid.shape)
            points, slopes = _points_and_slopes(grid, wider, heights_of(wider))
            yield _view(frame, posed, T, window, points[inner], slopes[(slice(None), *inner)])


def _view(
    frame: SurveyFrame,
    posed: PosedRun,
    T: Array,
    window: tuple[slice, slice],
    points: Array,
    slopes: Array,
) -> CellsSeen:
    range_m, std_m = (
        _sampled(values, points, T, posed.geometry) for values in (frame.range_m, frame.range_std_m)
    )
    offset = points - T[:3, 3]
    distance = np.linalg.norm(offset, axis=-1)
    ray = offset / distance[..., None]
    east, north = np.nan_to_num(slopes)
    lever = np.maximum(np.abs(ray[..., 2] - east * ray[..., 0] - north * ray[..., 1]), 0.05)
    with np.errstate(invalid="ignore"):
        off = range_m - distance
        seen = np.abs(off) < np.maximum(
            SETTINGS.gate_sigmas * std_m, SETTINGS.gate_voxels * posed.voxel_m
        )
    seen &= std_m > 0
    weight = np.where(seen, 1 / np.where(seen, std_m * lever, 1) ** 2, 0)
    footprint_m = (
        float(np.median(distance[seen])) / posed.geometry.focal_px if seen.any() else float("nan")
    )
    return CellsSeen(window, seen, weight, np.where(seen, off * lever, 0), footprint_m)


def _points_and_slopes(
    grid: Grid, window: tuple[slice, slice], height_m: Array
) -> tuple[Array, Array]:
    """(h, w, 3) centers of the cells of a window on the surface, and (2, h, w) its rise to the east
    and to the north.
    """
    rows, columns = np.gradient(height_m, grid.cell_m)
    return np.stack([*grid.centers(*window), height_m], axis=-1), np.stack([columns, -rows])


def _window(
    frame: SurveyFrame, grid: Grid, T: Array, geometry: RectifiedPair
) -> tuple[slice, slice] | None:
    """The cells that a frame can see."""
    step = SETTINGS.reach_step_px
    range_m = frame.range_m[::step, ::step]
    known = np.isfinite(range_m)
    if not known.any():
        return None
    points = transform_points(T, geometry.rays[::step, ::step][known] * range_m[known, None])
    margin_m = step * float(range_m[known].max()) / geometry.focal_px
    pixels, margin = grid.pixels(points), margin_m / grid.cell_m
    low = np.maximum(np.floor(pixels.min(axis=0) - margin).astype(int), 0)
    high = np.minimum(np.ceil(pixels.max(axis=0) + margin).astype(int) + 1, grid.shape[::-1])
    if (high <= low).any():
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _sampled(
    values: NDArray[np.float32], points: Array, T: Array, geometry: RectifiedPair
) -> Array:
    """(h, w) the values of a frame's nearest pixels at points (h, w, 3); NaN outside its image."""
    local = transform_points(inverse(T), points)
    width, height = geometry.image_size
    u, v = np.moveaxis(geometry.project(local), -1, 0)
    with np.errstate(invalid="ignore"):
        inside = (
            (local[..., 2] > 0) & (u > -0.5) & (v > -0.5) & (u < width - 0.5) & (v < height - 0.5)
        )
    result = np.full(points.shape[:2], np.nan)
    result[inside] = values[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    return result
