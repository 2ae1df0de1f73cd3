"""The rasters of a map, for exports that read them window by window."""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from typing import Any

from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.files.rasters import can_read_rasters, open_raster
from stereo_seecolor.run_folder.posed_run import PosedRun


def open_map_raster(posed: PosedRun, name: str, bands: int = 1) -> AbstractContextManager[Any]:
    """Rasterio's dataset of a map's GeoTIFF. Raises InputError where the map lacks it, DeviceError
    where the library that reads it is missing.
    """
    if not can_read_rasters():
        raise DeviceError(
            'the orthomosaic cannot be read without rasterio: pip install "stereo-seecolor[geo]"'
        )
    path = posed.map_folder / name
    if not path.is_file():
        raise InputError(f"{path}: does not exist: install the geo extra and fuse again")
    return open_raster(path, bands)


def windows_of(raster: Any, side_px: int) -> Iterator[Any]:
    """Rasterio's windows over a whole raster, of at most so many pixels a side."""
    from rasterio.windows import Window

    for row in range(0, raster.height, side_px):
        for column in range(0, raster.width, side_px):
            width, height = raster.width - column, raster.height - row
            yield Window(column, row, min(side_px, width), min(side_px, height))
