"""The mesh as 3-D Tiles 1.1 (OGC 22-025r4): for globes and maps in a browser.

One tile, mesh.glb; its y axis is up, which viewers turn back, so all else here is in the map's own axes, z up.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.export import glb
from stereo_seecolor.export.posed_run import PosedRun
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.geometry import pose
from stereo_seecolor.inputs.trajectories.axes import degrees_from_north_east, east_north_up_axes, geocentric_from_geodetic
from stereo_seecolor.mapping.raster.georeference import crs_name
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.run_folder.layout import MESH
from stereo_seecolor.version import __version__

NEAR_M = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]])
"""Points of a map in UTM by which it is put on the globe: its axes turn, and its lengths shrink, from place to place."""


def write(posed: PosedRun, folder: Path) -> None:
    """mesh.glb and tileset.json. Raises InputError as ``glb.write``."""
    glb.write(posed, folder)
    position = np.asarray(read_vertices(posed.map_folder / MESH)["position"], np.float64)
    low, high = position.min(axis=0), position.max(axis=0)
    box = [*((low + high) / 2), *np.diag(np.maximum(high - low, 1e-3) / 2).ravel()]
    root: dict[str, Any] = {
        "boundingVolume": {"box": [float(number) for number in box]},
        "geometricError": 0,
        "refine": "REPLACE",
        "content": {"uri": "mesh.glb"},
        "transform": _to_earth(posed).T.ravel().tolist(),  # column by column
    }
    asset = {"version": "1.1", "extras": {"generator": f"stereo-seecolor {__version__}", "crs": crs_name(posed.origin)}}
    tileset = {"asset": asset, "geometricError": float(np.linalg.norm(high - low)), "root": root}
    (folder / "tileset.json").write_text(json.dumps(tileset, indent=2) + "\n", encoding="utf-8")


def _to_earth(posed: PosedRun) -> NDArray[np.float64]:
    """(4, 4) from the map's coordinates to geocentric ones (EPSG:4978), its world's z taken as height above the ellipsoid; to the
    world's, where their place on Earth is not known."""
    shift = pose(np.eye(3), posed.offset_m)
    if posed.origin is None:
        return shift
    if posed.origin.utm_epsg is None:
        latitude_deg, longitude_deg = posed.origin.latitude_deg, posed.origin.longitude_deg
        axes = east_north_up_axes(latitude_deg, longitude_deg)
        return np.asarray(pose(axes.T, geocentric_from_geodetic(latitude_deg, longitude_deg, 0.0)) @ shift)
    here, *axes_ends = (_geocentric(point, posed.origin) for point in posed.offset_m + NEAR_M)
    return pose(np.stack([(end - here) / NEAR_M.max() for end in axes_ends], axis=-1), here)


def _geocentric(point_m: NDArray[np.float64], origin: GeoOrigin) -> NDArray[np.float64]:
    x_m, y_m, z_m = (float(value) for value in point_m)
    return geocentric_from_geodetic(*degrees_from_north_east(y_m, x_m, origin), z_m)
