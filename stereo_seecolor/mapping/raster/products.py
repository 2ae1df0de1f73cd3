"""What is made of a fused surface: terrain, mosaic, metrics, preview, and their files."""

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.files.map_files import whole
from stereo_seecolor.mapping.frame_index import FrameIndex, Progress
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.mosaic import render_mosaic
from stereo_seecolor.mapping.raster.preview import render_preview
from stereo_seecolor.mapping.raster.reef_metrics import ReefMetrics, measure_squares, site_of
from stereo_seecolor.mapping.raster.terrain import render_terrain
from stereo_seecolor.mapping.recovered import Frames
from stereo_seecolor.mapping.surface.fusion import Surface
from stereo_seecolor.records import GeoOrigin

PREVIEW_PX = 3000


@dataclass(frozen=True, eq=False)
class Piece:
    """A fused piece of a survey. surfaces: gives its tiles anew on each call. chosen: its frames."""

    folder: Path
    surfaces: Callable[[], Iterable[Surface]]
    index: FrameIndex
    T_world_camera: NDArray[np.float64]
    chosen: NDArray[np.int64]
    origin: GeoOrigin | None


def write_products(
    piece: Piece, frames: Frames, pair: RectifiedPair, config: MappingConfig, scratch: Path, progress: Progress
) -> list[Path]:
    """Write preview, terrain, mosaic and metrics; GeoTIFFs where the geo extra is there, else pictures and CSV only."""
    files = [_write_image(piece.folder / "preview.png", render_preview(piece.surfaces))]
    low, high = _extent(piece.surfaces())
    if not np.isfinite(low).all():
        return files
    dem_grid, mosaic_grid = Grid.around(low, high, config.dem_m), Grid.around(low, high, config.mosaic_m)
    terrain = render_terrain(piece.surfaces(), dem_grid, scratch / "terrain")
    mosaic = render_mosaic(
        frames, pair, piece.index, piece.T_world_camera, piece.chosen, terrain, mosaic_grid, scratch / "mosaic", progress
    )
    squares = measure_squares(terrain, config.metrics_m, scratch / "squares")
    files.append(_write_image(piece.folder / "orthomosaic_preview.png", _reduced(mosaic)))
    files.append(_write_csv(piece.folder / "reef_metrics.csv", squares))
    if georeference.available():
        for name, raster, descriptions in (
            ("dem.tif", terrain, ("height_m",)),
            ("orthomosaic.tif", mosaic, ()),
            ("reef_metrics.tif", squares, ReefMetrics.names()),
        ):
            georeference.write_geotiff(piece.folder / name, raster, piece.origin, descriptions)
            files.append(piece.folder / name)
        if piece.origin:
            georeference.write_laz(piece.folder / "cloud.laz", piece.folder / "cloud.ply", piece.origin)
            files.append(piece.folder / "cloud.laz")
    return files


def _extent(surfaces: Iterable[Surface]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for surface in surfaces:
        if len(surface.points_m):
            low, high = np.minimum(low, surface.points_m.min(axis=0)), np.maximum(high, surface.points_m.max(axis=0))
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


def _write_image(path: Path, image: NDArray[np.uint8]) -> Path:
    code = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    _, content = cv2.imencode(".png", cv2.cvtColor(image, code))
    with whole(path) as temporary:
        temporary.write_bytes(content.tobytes())
    return path


def _write_csv(path: Path, squares: BlockRaster) -> Path:
    """A row for the site, the mean of its squares, then one for each square that was seen; x and y of its center, meters."""
    seen, grid = [], squares.grid
    for rows, columns in squares.windows():
        block = squares.read(rows, columns)
        for row, column in np.argwhere(np.isfinite(block[1])):
            seen.append((rows.start + int(row), columns.start + int(column), block[:, row, column]))
    site = site_of(np.stack([values for *_, values in seen], axis=-1)) if seen else np.full(squares.bands, np.nan)
    with whole(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["square", "x_m", "y_m", *ReefMetrics.names()])
        writer.writerow(["site", "", "", *(f"{value:.6g}" for value in site)])
        for row, column, values in seen:
            x, y = grid.west_m + (column + 0.5) * grid.cell_m, grid.north_m - (row + 0.5) * grid.cell_m
            writer.writerow([f"{row}-{column}", f"{x:.3f}", f"{y:.3f}", *(f"{value:.6g}" for value in values)])
    return path
