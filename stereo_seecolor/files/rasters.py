"""Reading of GeoTIFFs: as GeoTIFFs alone, whatever their content says.

GDAL recognizes a file by its content: a ``dem.tif`` that is a virtual raster would open other
files, and the network.
"""

import importlib.util
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from calibration.quiet import ignored_warnings
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.whole_files import damaged_map, special_kind

_ALONE = {"GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR", "GDAL_PAM_ENABLED": "NO"}
"""GDAL looks for no file beside the raster, such as one with its overviews."""


@contextmanager
def open_raster(path: Path, bands: int = 1) -> Iterator[Any]:
    """Rasterio's dataset of a GeoTIFF with at least so many bands; an error of the block that is
    the file's becomes one line.

    Raises InputError where it cannot be read; ImportError without rasterio.
    """
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a file")
        with rasterio.Env(**_ALONE), ExitStack() as stack:
            with ignored_warnings(NotGeoreferencedWarning):
                file = stack.enter_context(rasterio.open(path.absolute(), driver="GTiff"))
            if file.transform.is_identity:
                raise damaged_map(path, "it has lost its position")
            if file.count < bands:
                raise damaged_map(path, f"it has {file.count} bands, not {bands}")
            yield file
    except RasterioError as error:
        raise damaged_map(path, error) from error
    except OSError as error:
        if error.filename not in (None, str(path)):
            raise
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def can_read_rasters() -> bool:
    """Tell whether rasterio is installed."""
    return importlib.util.find_spec("rasterio") is not None


def raster_problem(path: Path, bands: int = 1) -> str:
    """Why a GeoTIFF cannot be read to its last block; "" where it can. Needs rasterio."""
    try:
        with open_raster(path, bands) as file:
            for _, window in file.block_windows(1):
                file.read(window=window)
    except InputError as error:
        return str(error)
    return ""
