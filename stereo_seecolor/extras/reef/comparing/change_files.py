"""The files of a change: GeoTIFFs, a table of the patches, a picture, JSON."""

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.comparing.change_picture import picture
from stereo_seecolor.extras.reef.comparing.changed_patches import ChangedPatch
from stereo_seecolor.extras.reef.comparing.site_change import SiteChange
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.csv_tables import csv_text
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.mapping.raster.georeference import Georeference

FORMAT = "stereo-seecolor/change"


def write_change(folder: Path, change: SiteChange, place: Georeference) -> None:
    """Write all files of a change, in the first survey's coordinates; GeoTIFFs where rasterio can
    be imported. Raises OutputError.
    """
    write_atomic(
        folder / "change.png", cv2.imencode(".png", picture(change)[..., ::-1])[1].tobytes()
    )
    write_atomic(
        folder / "change.json", (json.dumps(description(change), indent=2) + "\n").encode()
    )
    names = [field.name for field in fields(ChangedPatch)]
    write_atomic(
        folder / "patches.csv",
        csv_text(names, (vars(patch).values() for patch in change.patches)).encode(),
    )
    if georeference.available():
        for name, bands in _rasters(change):
            _write_raster(folder, name, bands, change, place)


def description(change: SiteChange) -> dict[str, Any]:
    """The numbers of a change; null where one is not known."""
    found, at = change.difference, change.registration
    return {
        "format": FORMAT,
        "registration": {
            "T_first_second": at.T_a_b.tolist(),
            "scale": at.scale,
            "scale_std": at.scale_std,
            "covariance": at.covariance.tolist(),
            "center_m": at.center_m.tolist(),
            "features_alike": at.matches,
            "features_agreeing": at.agreeing,
            "feature_rms_m": at.feature_rms_m,
            "stable_fraction": at.stable,
            "surface_spread_m": at.spread_m,
            "features_to_surfaces_m": at.apart_m,
        },
        "overlap_m2": change.overlap_m2,
        "cell_m": change.before.grid.cell_m,
        "median_lod_m": found.median_lod_m,
        "error_inflation": found.inflation,
        "beyond_lod": change.beyond_lod,
        "growth_l": change.growth_l[0],
        "growth_std_l": change.growth_l[1],
        "loss_l": change.loss_l[0],
        "loss_std_l": change.loss_l[1],
        "patches": len(change.patches),
    }


def _rasters(change: SiteChange) -> Iterator[tuple[str, dict[str, NDArray[Any]]]]:
    found = change.difference
    yield (
        "height_change.tif",
        {
            "change_m": found.dz_m,
            "std_m": found.std_m,
            "level_of_detection_m": found.lod_m,
            "surface_distance_m": change.surface.distance_m,
            "surface_level_of_detection_m": change.surface.lod_m,
            "patch": change.labels,
        },
    )
    color = change.color
    yield (
        "color_change.tif",
        {
            "delta_e": color.delta_e,
            "lightness": color.change[..., 0],
            "chroma": color.change[..., 1],
        },
    )


def _write_raster(
    folder: Path, name: str, bands: dict[str, NDArray[Any]], change: SiteChange, place: Georeference
) -> None:
    scratch = folder / ".scratch" / name
    raster = BlockRaster(scratch, change.before.grid, len(bands), np.float32, np.nan)
    rows, columns = change.before.grid.shape
    raster.write(
        slice(0, rows),
        slice(0, columns),
        np.stack([band.astype(np.float32) for band in bands.values()]),
    )
    georeference.write_geotiff(folder / name, raster, place, tuple(bands))
