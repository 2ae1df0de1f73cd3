"""Products of a fused surface and their files: terrain, mosaic, metrics, preview."""

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import Threads, cores, in_background
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.files.atomic import atomic_path, write_atomic
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.block_raster import BlockRaster, Grid
from stereo_seecolor.mapping.raster.georeference import Georeference
from stereo_seecolor.mapping.raster.mosaic import render_mosaic
from stereo_seecolor.mapping.raster.reef_metrics import ReefMetrics, measure_squares, site_of
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.survey import Component

# A picture of the map, drawn in software: no screen and no graphics card is needed.

# Rasterization of triangles, the highest one winning: terrain from above, and previews from any
# side, without a screen.

EDGE = 1e-3
"""How far outside a triangle, as a fraction of it, a cell may lie: the map's vertices lie on cells'
centers, up to float32.
"""


@compiled
def rasterize(points: Any, attributes: Any, triangles: Any, height: Any, values: Any) -> None:
    """Draw triangles into ``height`` (H, W) and ``values`` (H, W, C), both changed in place.

    points: (V, 3) float64 column, row, height in pixels (center of the first at 0) and any unit; a
    cell takes the highest triangle over its center, NaN counts as lowest. attributes: (V, C),
    interpolated along.
    """
    rows, columns = height.shape
    for t in range(len(triangles)):
        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        first_row = max(int(np.ceil(min(a[1], b[1], c[1]) - EDGE)), 0)
        last_row = min(int(np.floor(max(a[1], b[1], c[1]) + EDGE)), rows - 1)
        first_column = max(int(np.ceil(min(a[0], b[0], c[0]) - EDGE)), 0)
        last_column = min(int(np.floor(max(a[0], b[0], c[0]) + EDGE)), columns - 1)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                u = ((c[0] - b[0]) * (row - b[1]) - (c[1] - b[1]) * (column - b[0])) / area
                v = ((a[0] - c[0]) * (row - c[1]) - (a[1] - c[1]) * (column - c[0])) / area
                w = 1.0 - u - v
                if u < -EDGE or v < -EDGE or w < -EDGE:
                    continue
                z = u * a[2] + v * b[2] + w * c[2]
                if height[row, column] >= z:
                    continue
                height[row, column] = z
                for k in range(values.shape[2]):
                    values[row, column, k] = (
                        u * attributes[triangles[t, 0], k]
                        + v * attributes[triangles[t, 1], k]
                        + w * attributes[triangles[t, 2], k]
                    )


LONGER_SIDE_PX = 1600  # fills a screen
ELEVATION_DEG = 50.0  # of the view: relief shows, and little hides behind it
AZIMUTH_DEG = 25.0  # of the view, off the axes of most surveys
LIGHT = np.array([-0.4, 0.3, 0.866])
BACKGROUND = 255  # white


def render_preview(surfaces: Callable[[], Iterable[Surface]]) -> NDArray[np.uint8]:
    """Draw the map from a slant, in parallel projection, lightly shaded: (H, W, 3) RGB. surfaces:
    gives the tiles again on each call.
    """
    R = _view()
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for surface in surfaces():
        if len(surface.points_m):
            seen = surface.points_m @ R[:2].T
            low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    if not np.isfinite(low).all():
        return np.full((64, 64, 3), BACKGROUND, np.uint8)
    pixel_m = float((high - low).max()) / LONGER_SIDE_PX
    shape = tuple(int(n) + 3 for n in ((high - low) / pixel_m)[::-1])
    depth, image = np.full(shape, np.nan), np.full((*shape, 3), float(BACKGROUND), np.float32)
    for surface in surfaces():
        seen = surface.points_m.astype(np.float64) @ R.T
        points = np.stack(
            [(seen[:, 0] - low[0]) / pixel_m + 1, (high[1] - seen[:, 1]) / pixel_m + 1, seen[:, 2]],
            axis=-1,
        )
        light = 0.65 + 0.35 * np.clip(surface.normals @ LIGHT, 0, 1)[:, None]
        rasterize(
            points, (surface.colors * light).astype(np.float32), surface.triangles, depth, image
        )
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _view() -> NDArray[np.float64]:
    """Rows: right, up and towards the viewer, who looks down from the south by the elevation,
    turned by the azimuth.
    """
    a, e = np.radians(AZIMUTH_DEG), np.radians(ELEVATION_DEG)
    right = np.array([np.cos(a), np.sin(a), 0])
    viewer = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    return np.stack([right, np.cross(viewer, right), viewer])


# The terrain model: the height of the highest fused surface over each cell.


def render_terrain(surfaces: Iterable[Surface], grid: Grid, folder: Path) -> BlockRaster:
    """Render the heights of the surfaces: (1, H, W) float32 meters, NaN where nothing was seen."""
    terrain = BlockRaster(folder, grid, 1, np.float32, np.nan)
    for surface in surfaces:
        if not len(surface.triangles):
            continue
        pixels = grid.pixels(surface.points_m)
        low = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 1, grid.shape[::-1])
        rows, columns = slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
        heights = terrain.read(rows, columns)
        points = np.concatenate([pixels - low, surface.points_m[:, 2:]], axis=1).astype(np.float64)
        no_colors = np.zeros((len(points), 0), np.float32)
        rasterize(
            points,
            no_colors,
            surface.triangles,
            heights[0],
            np.zeros((*heights.shape[1:], 0), np.float32),
        )
        terrain.write(rows, columns, heights)
    return terrain


def known_area_m2(blocks: Iterable[NDArray[np.floating]], cell_m: float) -> float:
    """The planar area that a map shows: of all cells of its terrain that have a height. blocks: of
    heights, NaN where unknown.
    """
    return sum(int(np.isfinite(heights).sum()) for heights in blocks) * cell_m**2


PREVIEW_PX = 3000
"""Longer side of orthomosaic_preview.png: opens anywhere."""

Surfaces = Callable[[], Iterable[Surface]]
"""Gives a map's tiles again on each call."""


@dataclass(frozen=True, eq=False)
class Rasters:
    """The rasters of a map, each on its own grid: heights (1, H, W), colors (4, H, W), metrics (M,
    H, W).
    """

    terrain: BlockRaster
    mosaic: BlockRaster
    squares: BlockRaster

    @classmethod
    def render(
        cls, component: Component, surfaces: Surfaces, config: MappingConfig, scratch: Path
    ) -> "Rasters | None":
        """Render all rasters of a component; None where there is no surface."""
        low, high = _extent(surfaces())
        if not np.isfinite(low).all():
            return None
        terrain = render_terrain(
            surfaces(), Grid.around(low, high, config.terrain_cell_m), scratch / "terrain"
        )
        with in_background(
            partial(measure_squares, terrain, config.square_m, scratch / "squares")
        ) as squares:
            mosaic = render_mosaic(
                component, terrain, Grid.around(low, high, config.mosaic_cell_m), scratch / "mosaic"
            )
        return cls(terrain, mosaic, squares.result())

    @property
    def area_m2(self) -> float:
        """The planar area that the map shows."""
        return known_area_m2(
            (self.terrain.read(*window) for window in self.terrain.windows()),
            self.terrain.grid.cell_m,
        )


def write_preview(folder: Path, surfaces: Surfaces) -> Path:
    """Write preview.png, the map from a slant."""
    return _write_image(folder / "preview.png", render_preview(surfaces))


def write_rasters(folder: Path, rasters: Rasters, place: Georeference) -> Iterator[Path]:
    """Write the mosaic, reduced, and the metrics as a table; with the geo extra also GeoTIFFs, and
    the cloud as LAZ.
    """
    works: list[Callable[[], Path]] = [
        lambda: _write_image(folder / "orthomosaic_preview.png", _reduced(rasters.mosaic)),
        partial(_write_csv, folder / "reef_metrics.csv", rasters.squares, place),
    ]
    if georeference.available():
        write = georeference.write_geotiff
        works += [
            partial(write, folder / "dem.tif", rasters.terrain, place, ("height_m",)),
            partial(write, folder / "orthomosaic.tif", rasters.mosaic, place),
            partial(
                write, folder / "reef_metrics.tif", rasters.squares, place, ReefMetrics.names()
            ),
        ]
        if place.origin:
            works.append(
                partial(georeference.write_laz, folder / "cloud.laz", folder / "cloud.ply", place)
            )
    return Threads(cores()).each(lambda work: work(), works)


def _extent(surfaces: Iterable[Surface]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for surface in surfaces:
        if len(surface.points_m):
            low, high = (
                np.minimum(low, surface.points_m.min(axis=0)),
                np.maximum(high, surface.points_m.max(axis=0)),
            )
    return low, high


def _reduced(mosaic: BlockRaster) -> NDArray[np.uint8]:
    """(h, w, 4) of at most about 3000 px a side."""
    step = 2 ** max(0, int(np.ceil(np.log2(max(mosaic.grid.shape) / PREVIEW_PX))))
    image = np.zeros((*(-(-n // step) for n in mosaic.grid.shape), 4), np.uint8)
    for rows, columns in mosaic.windows():
        block = np.moveaxis(mosaic.read(rows, columns), 0, -1)
        size = -(-block.shape[1] // step), -(-block.shape[0] // step)
        part = cv2.resize(block, size, interpolation=cv2.INTER_AREA)
        image[rows.start // step :, columns.start // step :][: size[1], : size[0]] = part
    return image


def encoded(image: NDArray[np.uint8]) -> bytes:
    """Encode an RGB or RGBA image (H, W, 3 or 4) as a PNG."""
    code = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return cv2.imencode(".png", cv2.cvtColor(image, code))[1].tobytes()


def _write_image(path: Path, image: NDArray[np.uint8]) -> Path:
    write_atomic(path, encoded(image))
    return path


def _write_csv(path: Path, squares: BlockRaster, place: Georeference) -> Path:
    """A row for the site, the mean of its squares, then one for each square that was seen; x and y
    of its center, meters.
    """
    seen, grid = [], squares.grid
    for rows, columns in squares.windows():
        block = squares.read(rows, columns)
        for row, column in np.argwhere(np.isfinite(block[1])):
            seen.append((rows.start + int(row), columns.start + int(column), block[:, row, column]))
    site = (
        site_of(np.stack([values for *_, values in seen], axis=-1))
        if seen
        else np.full(squares.bands, np.nan)
    )
    with atomic_path(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["square", "x_m", "y_m", *ReefMetrics.names()])
        writer.writerow(["site", "", "", *(f"{value:.6g}" for value in site)])
        for row, column, values in seen:
            x, y = (
                grid.west_m + (column + 0.5) * grid.cell_m,
                grid.north_m - (row + 0.5) * grid.cell_m,
            )
            x, y = x + place.offset_m[0], y + place.offset_m[1]
            writer.writerow(
                [f"{row}-{column}", f"{x:.3f}", f"{y:.3f}", *(f"{value:.6g}" for value in values)]
            )
    return path
