"""The surface of a site as a fused run has it: its mesh, and its terrain, seen from above."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.geometry import inverse, scale_of, transformed
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.noise import averaged
from stereo_seecolor.mapping.raster.rasterize import rasterize
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.run_folder.layout import MAP, MESH
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run

# The mesh of a fused run in memory, in coordinates that the caller chooses.

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SiteMesh:
    """points_m, normals: (V, 3) float64, z up, the map's own coordinates. color: (V, 3) uint8.
    triangles: (T, 3) vertex numbers.
    """

    points_m: Array
    normals: Array
    color: NDArray[np.uint8]
    triangles: NDArray[np.int32]

    def moved(self, T: Array) -> "SiteMesh":
        """The mesh through a similarity (4, 4)."""
        R = T[:3, :3] / scale_of(T)
        return SiteMesh(
            transformed(T, self.points_m), self.normals @ R.T, self.color, self.triangles
        )

    @property
    def triangle_areas_m2(self) -> Array:
        """The area of each triangle: (T,)."""
        a, b, c = (self.points_m[self.triangles[:, k]] for k in range(3))
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    @property
    def triangle_centers_m(self) -> Array:
        """The center of each triangle: (T, 3)."""
        return np.asarray(self.points_m[self.triangles].mean(axis=1))


def read_mesh(out: Path) -> SiteMesh:
    """The mesh of the map's main component in OUT/map."""
    path = out / MAP / MESH
    vertices = read_vertices(path)
    points, normals = (np.asarray(vertices[name], np.float64) for name in ("position", "normal"))
    return SiteMesh(
        points, normals, np.array(vertices["color"]), np.array(read_triangles(path)["indices"])
    )


@dataclass(frozen=True, eq=False)
class Site:
    """A fused run and its mesh, in the map's own coordinates."""

    posed: PosedRun
    mesh: SiteMesh


def open_site(out: Path) -> Site:
    """A fused run. Raises InputError for one without a map, or with an empty one."""
    posed, mesh = open_posed_run(out), read_mesh(out)
    if not len(mesh.triangles):
        raise InputError(
            f"{out}: its map is empty: fuse it again with more frames or a larger mapping.voxel_m"
        )
    return Site(posed, mesh)


# Terrain of a mesh: heights and colors seen from straight above, on a grid.


@dataclass(frozen=True, eq=False)
class Terrain:
    """The highest surface over each cell of ``grid``: height_m (H, W), color (H, W, 3) 0..255 as
    float32; NaN where unknown.
    """

    grid: Grid
    height_m: NDArray[np.float64]
    color: NDArray[np.float32]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where there is a surface: (H, W) bool."""
        return np.isfinite(self.height_m)

    @property
    def slopes(self) -> NDArray[np.float64]:
        """The rise of the surface to the east and to the north: (2, H, W), NaN at holes."""
        rows, columns = np.gradient(self.height_m, self.grid.cell_m)
        return np.stack([columns, -rows])

    @property
    def points_m(self) -> NDArray[np.float64]:
        """The cells' centers on the surface: (H, W, 3)."""
        x, y = self.grid.centers(slice(0, self.grid.shape[0]), slice(0, self.grid.shape[1]))
        return np.stack([x, y, self.height_m], axis=-1)

    def averaged(self, cells: int) -> "Terrain":
        """The terrain in cells that are so many times as long and wide, without colors; what does
        not fill one is left out.
        """
        grid = self.grid
        height_m = averaged(self.height_m, cells)
        coarse = Grid(
            grid.west_m, grid.north_m, cells * grid.cell_m, (height_m.shape[0], height_m.shape[1])
        )
        return Terrain(coarse, height_m, np.full((*height_m.shape, 3), np.nan, np.float32))

    def triangles_of(
        self, mesh: SiteMesh
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Row, column and square meters (n,) of a mesh's triangles over, and below, the cells."""
        column, row = np.rint(self.grid.pixels(mesh.triangle_centers_m)).astype(np.int64).T
        height, width = self.grid.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        return row[inside], column[inside], mesh.triangle_areas_m2[inside]


def grid_of(mesh: SiteMesh, cell_m: float) -> Grid:
    """The cells that cover a mesh."""
    return Grid.around(mesh.points_m.min(axis=0), mesh.points_m.max(axis=0), cell_m)


def terrain_of(mesh: SiteMesh, grid: Grid) -> Terrain:
    """A mesh on a grid."""
    height = np.full(grid.shape, np.nan)
    color = np.full((*grid.shape, 3), np.nan, np.float32)
    pixels = np.concatenate([grid.pixels(mesh.points_m), mesh.points_m[:, 2:]], axis=1)
    rasterize(pixels, mesh.color.astype(np.float32), mesh.triangles, height, color)
    return Terrain(grid, height, color)


# Standard errors of a fused terrain, cell by cell, from the standard errors of the ranges and the
# number of views.
#
# Each frame's measured ranges are compared with the terrain along its own rays. A range error dr
# moves the surface over a cell by dz = dr (r_z - p r_x - q r_y), r the ray and p, q the slopes.
# Independent views weigh 1 / variance; where they differ by more than their standard errors say,
# the mean's is widened by the Birge ratio (Birge 1932, Phys. Rev. 40). At rims all views are wrong
# alike, which height_stds of mapping/raster/noise.py adds.


@dataclass(frozen=True)
class ErrorSettings:
    """Which ranges count as a view of a cell."""

    # a range further off than this shows something else: a fish, a branch before the cell
    gate_sigmas: float = 6.0
    gate_voxels: float = 3.0  # and further than this, since voxels round off what is finer
    reach_step_px: int = 16  # of the pixels that show which cells a frame can see
    match_px: float = 3.0  # errors of neighboring pixels are alike over about half a census window


SETTINGS = ErrorSettings()


@dataclass(frozen=True, eq=False)
class TerrainErrors:
    """Standard errors of a terrain.

    std_m: (H, W) standard error of each height by its views, NaN where no frame's range was left.
    noise_m: the part of it by the errors of ranges, without what views differ by at edges, which
    roughens a surface. views: (H, W) frames behind each cell. correlation_m: distance over which
    errors of neighboring cells are correlated.
    """

    std_m: Array
    noise_m: Array
    views: NDArray[np.int32]
    correlation_m: float


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
        return TerrainErrors(
            noise_m * np.sqrt(birge), noise_m, self._views, SETTINGS.match_px * footprint
        )

    def _window(self, frame: SurveyFrame, T: Array) -> tuple[slice, slice] | None:
        """The cells that a frame can see."""
        step = SETTINGS.reach_step_px
        range_m = frame.range_m[::step, ::step]
        known = np.isfinite(range_m)
        if not known.any():
            return None
        points = transformed(T, self._geometry.rays[::step, ::step][known] * range_m[known, None])
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
    local = transformed(inverse(T), points)
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
