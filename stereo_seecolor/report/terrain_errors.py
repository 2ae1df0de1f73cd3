"""Standard errors of a fused terrain, cell by cell, from the standard errors of the ranges and the
number of views.

Each frame's measured ranges are compared with the terrain along its own rays. A range error dr
moves the surface over a cell by dz = dr (r_z - p r_x - q r_y), r the ray and p, q the slopes.
Independent views weigh 1 / variance; where they differ by more than their standard errors say, the
mean's is widened by the Birge ratio (Birge 1932, Phys. Rev. 40). At rims all views are wrong alike,
which height_stds of mapping/raster/noise.py adds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.errors import FrameError
from stereo_seecolor.geometry import inverse, transform_points
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_model import Terrain, TerrainErrors
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.run_folder.posed_run import MATCH_PX, PosedRun

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorSettings:
    """Which ranges count as a view of a cell."""

    # a range further off than this shows something else: a fish, a branch before the cell
    gate_sigmas: float = 6.0
    gate_voxels: float = 3.0  # and further than this, since voxels round off what is finer
    reach_step_px: int = 16  # of the pixels that show which cells a frame can see


SETTINGS = ErrorSettings()


def terrain_errors(
    posed: PosedRun, terrain: Terrain, T_terrain_map: Array | None = None
) -> TerrainErrors:
    """The standard errors of the terrain of a run. T_terrain_map: (4, 4), where the terrain is not
    in the map's own coordinates.

    Raises InputError if the run cannot be read; a frame whose files are gone is left out.
    """
    T = np.eye(4) if T_terrain_map is None else T_terrain_map
    frames, sums = posed.survey, _Sums(terrain, posed.geometry, posed.voxel_m)
    for number, T_map_camera in enumerate(posed.T_map_camera):
        try:
            sums.add(frames[number], T @ T_map_camera)
        except FrameError:
            continue
    return sums.errors()


class _Sums:
    """Weights, residuals and views of each cell, summed over frames."""

    def __init__(self, terrain: Terrain, geometry: RectifiedPair, voxel_m: float) -> None:
        self._terrain, self._geometry, self._voxel_m = terrain, geometry, voxel_m
        self._slopes = np.nan_to_num(terrain.slopes)
        self._points = terrain.points_m
        self._weight, self._square = np.zeros(terrain.grid.shape), np.zeros(terrain.grid.shape)
        self._mean = np.zeros(terrain.grid.shape)
        self._views = np.zeros(terrain.grid.shape, np.int32)
        self._footprints_m: list[float] = []

    def add(self, frame: SurveyFrame, T_terrain_camera: Array) -> None:
        """One more frame."""
        window = self._window(frame, T_terrain_camera)
        if window is None:
            return
        points = self._points[window]
        range_m, std_m = (
            _sampled(values, points, T_terrain_camera, self._geometry)
            for values in (frame.range_m, frame.range_std_m)
        )
        offset = points - T_terrain_camera[:3, 3]
        distance = np.linalg.norm(offset, axis=-1)
        ray = offset / distance[..., None]
        east, north = self._slopes[(slice(None), *window)]
        lever = np.maximum(np.abs(ray[..., 2] - east * ray[..., 0] - north * ray[..., 1]), 0.05)
        with np.errstate(invalid="ignore"):
            off = range_m - distance
            seen = np.abs(off) < np.maximum(
                SETTINGS.gate_sigmas * std_m, SETTINGS.gate_voxels * self._voxel_m
            )
        seen &= std_m > 0
        weight = np.where(seen, 1 / np.where(seen, std_m * lever, 1) ** 2, 0)
        height_off = np.where(seen, off * lever, 0)
        self._weight[window] += weight
        self._mean[window] += weight * height_off
        self._square[window] += weight * height_off**2
        self._views[window] += seen
        if seen.any():
            self._footprints_m.append(float(np.median(distance[seen])) / self._geometry.focal_px)

    def errors(self) -> TerrainErrors:
        """What the frames together say."""
        known = self._views > 0
        weight = np.where(known, self._weight, 1)
        spread = np.maximum(self._square - self._mean**2 / weight, 0)
        birge = np.maximum(spread / np.maximum(self._views - 1, 1), 1)
        noise_m = np.where(known & self._terrain.known, 1 / np.sqrt(weight), np.nan)
        footprint = (
            float(np.median(self._footprints_m))
            if self._footprints_m
            else self._terrain.grid.cell_m
        )
        return TerrainErrors(noise_m * np.sqrt(birge), noise_m, self._views, MATCH_PX * footprint)

    def _window(self, frame: SurveyFrame, T: Array) -> tuple[slice, slice] | None:
        """The cells that a frame can see."""
        step = SETTINGS.reach_step_px
        range_m = frame.range_m[::step, ::step]
        known = np.isfinite(range_m)
        if not known.any():
            return None
        points = transform_points(
            T, self._geometry.rays[::step, ::step][known] * range_m[known, None]
        )
        return _covered(
            self._terrain.grid,
            points,
            margin_m=step * float(range_m[known].max()) / self._geometry.focal_px,
        )


def _covered(grid: Grid, points: Array, margin_m: float) -> tuple[slice, slice] | None:
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
    with np.errstate(invalid="ignore", divide="ignore"):
        u = geometry.focal_px * local[..., 0] / local[..., 2] + geometry.cx_left_px
        v = geometry.focal_px * local[..., 1] / local[..., 2] + geometry.cy_px
        inside = (
            (local[..., 2] > 0) & (u > -0.5) & (v > -0.5) & (u < width - 0.5) & (v < height - 0.5)
        )
    result = np.full(points.shape[:2], np.nan)
    result[inside] = values[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    return result
