"""Products of a fused surface and their files: terrain, mosaic, metrics, preview."""

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Threads, cores, in_background
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.files.atomic import atomic_path, write_atomic
from stereo_seecolor.mapping.component import Component
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.gaps import Reason, render_gaps
from stereo_seecolor.mapping.raster.georeference import Georeference
from stereo_seecolor.mapping.raster.grid import Grid, bounds
from stereo_seecolor.mapping.raster.mosaic import render_mosaic
from stereo_seecolor.mapping.raster.preview import render_preview
from stereo_seecolor.mapping.raster.reef_metrics import ReefMetrics, measure_squares, site_of
from stereo_seecolor.mapping.raster.terrain import known_area_m2, render_terrain
from stereo_seecolor.mapping.surface.surface import Surface

PREVIEW_PX = 3000
"""Longer side of orthomosaic_preview.png: opens anywhere."""

Surfaces = Callable[[], Iterable[Surface]]
"""Gives a map's tiles again on each call."""


@dataclass(frozen=True, eq=False)
class Rasters:
    """The rasters of a map, each on its own grid: heights (1, H, W), colors (4, H, W), metrics (M,
    H, W); gaps (1, H, W), on that of the heights.
    """

    terrain: BlockRaster
    mosaic: BlockRaster
    squares: BlockRaster
    gaps: BlockRaster

    @classmethod
    def render(
        cls, component: Component, surfaces: Surfaces, config: MappingConfig, scratch: Path
    ) -> "Rasters | None":
        """Render all rasters of a component; None where there is no surface."""
        low, high = bounds(surface.points_m for surface in surfaces())
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
        gaps = render_gaps(component, terrain, config.voxel_edge_m, scratch / "gaps")
        return cls(terrain, mosaic, squares.result(), gaps)

    @property
    def area_m2(self) -> float:
        """The planar area that the map shows."""
        return known_area_m2(
            (self.terrain.read(*window) for window in self.terrain.windows()),
            self.terrain.grid.cell_m,
        )

    @property
    def missing_fraction(self) -> float:
        """The part of the measured ground that has no height, because its ranges are too uncertain
        or disagree.
        """
        reasons = (self.gaps.read(*window) for window in self.gaps.windows())
        missing = sum(
            int(np.isin(each, (Reason.UNCERTAIN, Reason.DISAGREE)).sum()) for each in reasons
        )
        known = self.area_m2 / self.terrain.grid.cell_m**2
        return missing / max(missing + known, 1)


def write_preview(folder: Path, surfaces: Surfaces) -> Path:
    """Write preview.png, the map from a slant."""
    return _write_image(folder / "preview.png", render_preview(surfaces))


def write_rasters(folder: Path, rasters: Rasters, place: Georeference) -> Iterator[Path]:
    """Write the mosaic, reduced, and the metrics; with the geo extra also GeoTIFFs and LAZ."""
    works: list[Callable[[], Path]] = [
        lambda: _write_image(folder / "orthomosaic_preview.png", _reduced(rasters.mosaic)),
        partial(_write_csv, folder / "reef_metrics.csv", rasters.squares, place),
    ]
    if georeference.available():
        write = georeference.write_geotiff
        works += [
            partial(write, folder / "dem.tif", rasters.terrain, place, (georeference.HEIGHTS,)),
            partial(write, folder / "orthomosaic.tif", rasters.mosaic, place),
            partial(write, folder / "gaps.tif", rasters.gaps, place, ("reason",)),
            partial(
                write, folder / "reef_metrics.tif", rasters.squares, place, ReefMetrics.names()
            ),
        ]
        if place.origin:
            works.append(
                partial(georeference.write_laz, folder / "cloud.laz", folder / "cloud.ply", place)
            )
    return Threads(cores()).each(lambda work: work(), works)


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
    """A row for the site, the mean of its squares, then one a square; x and y in meters."""
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
            x, y = grid.moved(place.offset_m).center(column, row)
            writer.writerow(
                [f"{row}-{column}", f"{x:.3f}", f"{y:.3f}", *(f"{value:.6g}" for value in values)]
            )
    return path
