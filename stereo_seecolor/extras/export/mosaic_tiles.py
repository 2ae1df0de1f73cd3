"""The orthomosaic cut into images of the size that annotation tools take (CoralNet: at most 8000 px
a side), with the scale of each.
"""

import csv
from pathlib import Path

import numpy as np

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.map_rasters import open_map_raster
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.run_folder.layout import MOSAIC
from stereo_seecolor.run_folder.posed_run import PosedRun

MOST_PX = 8000
"""CoralNet's limit for a side."""
COLUMNS = (
    *("name", "width_px", "height_px", "meters_per_pixel", "height_cm"),
    *("west_m", "north_m", "seen_fraction"),
)
LEAST_SEEN = 0.01
"""Tiles of which less than this fraction was seen are left out."""


def write(posed: PosedRun, folder: Path) -> None:
    """``tiles/ROW_COLUMN.png`` and tiles.csv: name, size, meters a pixel, centimeters of height,
    world coordinates of the corner.

    Raises InputError if the map has no orthomosaic, DeviceError if its library is missing.
    """
    with (
        open_map_raster(posed, MOSAIC, 4) as mosaic,
        (folder / "tiles.csv").open("w", encoding="utf-8", newline="") as table,
    ):
        from rasterio.windows import Window

        (folder / "tiles").mkdir()
        meters = float(mosaic.transform.a)
        writer = csv.writer(table)
        writer.writerow(COLUMNS)
        for row, column, window in windows(mosaic.width, mosaic.height):
            rgba = mosaic.read(window=Window(*window))
            seen = float((rgba[3] > 0).mean())
            if seen < LEAST_SEEN:
                continue
            name = f"{row}_{column}.png"
            (folder / "tiles" / name).write_bytes(
                encode_image(np.ascontiguousarray(np.moveaxis(rgba[:3], 0, -1)), "png")
            )
            west_m, north_m = mosaic.xy(window[1], window[0], offset="ul")
            numbers = (window[2], window[3], f"{meters:.6g}", f"{100 * meters * window[3]:.2f}")
            writer.writerow([name, *numbers, f"{west_m:.4f}", f"{north_m:.4f}", f"{seen:.3f}"])


def windows(width: int, height: int) -> list[tuple[int, int, tuple[int, int, int, int]]]:
    """Row, column and (left, top, width, height) of equal tiles, as few as the limit allows."""
    columns, rows = -(-width // MOST_PX), -(-height // MOST_PX)
    x = np.linspace(0, width, columns + 1).round().astype(int).tolist()
    y = np.linspace(0, height, rows + 1).round().astype(int).tolist()
    return [
        (row, column, (x[column], y[row], x[column + 1] - x[column], y[row + 1] - y[row]))
        for row in range(rows)
        for column in range(columns)
    ]


FORMAT = ExportFormat(
    "the orthomosaic in tiles of at most 8000 px, with meters per pixel", "CoralNet, BIIGLE", write
)
