"""A TagLab project: orthomosaic and terrain model of one size, and the JSON that names them.

Names and limits are those of TagLab's project files; corals outlined there come back by ``metrics
--polygons project.json``.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.map_rasters import open_map_raster, windows_of
from stereo_seecolor.run_folder.layout import MOSAIC, TERRAIN
from stereo_seecolor.run_folder.posed_run import PosedRun

MOST_PX = 32767
"""A side, at most."""
NO_DATA = -9999.0
BLOCK_PX = 2048


def write(posed: PosedRun, folder: Path) -> None:
    """``rgb.tif``, ``dem.tif`` and ``project.json``.

    Raises InputError if the map has no orthomosaic or it is too large, DeviceError if the library
    that reads it is missing.
    """
    with open_map_raster(posed, MOSAIC, 4) as mosaic:
        if max(mosaic.width, mosaic.height) > MOST_PX:
            raise InputError(
                f"{posed.map_folder / MOSAIC}: has more than {MOST_PX} px on a side, TagLab's "
                "limit: fuse with a larger mapping.mosaic_m"
            )
        _write_colors(mosaic, folder / "rgb.tif")
        # what cannot be read is named by the innermost
        with open_map_raster(posed, TERRAIN) as terrain:
            _write_heights(terrain, mosaic, folder / "dem.tif")
        project = _project(posed, (mosaic.width, mosaic.height), 1000 * mosaic.res[0])
    (folder / "project.json").write_text(json.dumps(project, indent=1) + "\n", encoding="utf-8")


def _profile(mosaic: Any, count: int, dtype: str, **more: Any) -> dict[str, Any]:
    return {
        "driver": "GTiff",
        "count": count,
        "dtype": dtype,
        "width": mosaic.width,
        "height": mosaic.height,
        "crs": mosaic.crs,
        "transform": mosaic.transform,
        "tiled": True,
        "compress": "deflate",
        "bigtiff": "if_safer",
        **more,
    }


def _write_colors(mosaic: Any, path: Path) -> None:
    """Without transparency: TagLab takes RGB."""
    import rasterio

    with rasterio.open(path, "w", **_profile(mosaic, 3, "uint8", photometric="RGB")) as file:
        for window in windows_of(mosaic, BLOCK_PX):
            file.write(mosaic.read((1, 2, 3), window=window), window=window)


def _write_heights(terrain: Any, mosaic: Any, path: Path) -> None:
    """The terrain on the orthomosaic's pixels; no NaN, which TagLab does not expect."""
    import rasterio

    heights: NDArray[np.float32] = terrain.read(1)
    with rasterio.open(path, "w", **_profile(mosaic, 1, "float32", nodata=NO_DATA)) as file:
        file.offsets = terrain.offsets[:1]  # of a map deep in the sea, whose heights lack it
        for window in windows_of(mosaic, BLOCK_PX):
            x = (
                mosaic.bounds.left
                + (np.arange(window.width) + window.col_off + 0.5) * mosaic.res[0]
            )
            y = (
                mosaic.bounds.top
                - (np.arange(window.height) + window.row_off + 0.5) * mosaic.res[1]
            )
            column, row = np.meshgrid(
                (x - terrain.bounds.left) / terrain.res[0] - 0.5,
                (terrain.bounds.top - y) / terrain.res[1] - 0.5,
            )
            at = column.astype(np.float32), row.astype(np.float32)
            found = cv2.remap(
                heights,
                *at,
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=float("nan"),
            )
            file.write(np.where(np.isfinite(found), found, np.float32(NO_DATA)), 1, window=window)


def _project(posed: PosedRun, size: tuple[int, int], mm: float) -> dict[str, Any]:
    name = posed.run.root.resolve().name
    dates = [
        *(frame.taken.date().isoformat() for frame in posed.frames if frame.taken),
        posed.run.made[:10],
    ]
    image = {
        "rect": [0.0, 0.0, 0.0, 0.0],
        "map_px_to_mm_factor": f"{mm:.9g}",
        "width": size[0],
        "height": size[1],
        "annotations": {"regions": [], "points": []},
        "layers": [],
        "channels": [
            {"filename": "rgb.tif", "type": "RGB"},
            {"filename": "dem.tif", "type": "DEM"},
        ],
        "id": name,
        "name": name,
        "acquisition_date": dates[0],
        "georef_filename": "rgb.tif" if posed.origin else "",
        "workspace": [],
        "export_dataset_area": [],
        "metadata": {},
    }
    return {
        "filename": "project.json",
        "images": [image],
        "correspondences": {},
        "labels": {},
        "metadata": {},
    }


FORMAT = ExportFormat(
    "orthomosaic and terrain model of equal size, and a project that names them", "TagLab", write
)
