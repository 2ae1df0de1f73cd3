"""The textured surface as 3-D Tiles 1.1 (OGC 22-025r4): for globes and maps in a browser.

A tree of tiles: each is replaced by up to four of half its side, with twice the detail, as the
viewer comes near. Their y axis is up, which viewers turn back, so all else here is in the map's own
axes, z up.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from calibration.transforms import rigid_transform
from stereo_seecolor.earth import (
    degrees_from_north_east,
    east_north_up_axes,
    geocentric_from_geodetic,
)
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.simplified_surface import SimplifiedSurface, longest_edge_m
from stereo_seecolor.extras.export.textured import open_surface, painted, summary, write_group
from stereo_seecolor.mapping.raster.georeference import crs_name
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.texture.views import Views
from stereo_seecolor.version import __version__

NEAR_M = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]])
"""Points of a map in UTM by which it is put on the globe: its axes turn, and its lengths shrink,
from place to place.
"""


DEPTH_UNKNOWN = "the depths are unknown, so that the map lies near the water surface"


@dataclass(frozen=True)
class TileLimits:
    """The size of a tile of the finest level, which a viewer must load in a moment."""

    triangles: int = 50_000
    pixels: int = 4_000_000
    viewer_px: float = 16.0
    """Viewers refine what errs by more pixels of the screen than this (CesiumJS): a texel is to be
    one of them at most.
    """


LIMITS = TileLimits()


def write(posed: PosedRun, folder: Path) -> str:
    """tileset.json, and tiles/LEVEL/COLUMN_ROW.glb: level 0 is the whole map, and each further one
    twice as fine.

    Raises InputError if an image is gone or damaged.
    """
    surface, boxes, finest_is = open_surface(posed), {}, ""
    views = Views(posed)
    finest = _finest_level(posed, surface)
    low, high = surface.position.min(axis=0), surface.position.max(axis=0)
    side_m = max(float((high - low)[:2].max()), 1e-3) * (1 + 1e-9)
    errors_m = []
    for level in range(finest, -1, -1):
        step = 1 << (finest - level)
        if level < finest:
            surface = surface.simplify(surface.bound_m, longest_edge_m(posed))
        made = painted(views, surface, _cells(surface, low, side_m, level))
        finest_is = finest_is or summary(made, surface)
        errors_m.append(max(surface.bound_m, LIMITS.viewer_px * step * posed.pixel_m))
        (folder / "tiles" / str(level)).mkdir(parents=True)
        for cell in np.unique(made.group).tolist():
            row, column = divmod(cell, 1 << level)
            write_group(made, surface, folder / _uri(level, column, row), cell, step)
            boxes[level, column, row] = _bounds(
                surface.position[surface.triangles[made.group == cell]].reshape(-1, 3)
            )
    root, _ = _tile(boxes, errors_m[::-1], (0, 0, 0))
    root["transform"] = _to_earth(posed).T.ravel().tolist()  # column by column
    asset = {
        "version": "1.1",
        "extras": {"generator": f"stereo-seecolor {__version__}", "crs": crs_name(posed.origin)},
    }
    tileset = {"asset": asset, "geometricError": float(np.linalg.norm(high - low)), "root": root}
    (folder / "tileset.json").write_text(json.dumps(tileset, indent=2) + "\n", encoding="utf-8")
    is_known = posed.origin is None or posed.origin.depth_known
    depth = "" if is_known else f"; {DEPTH_UNKNOWN}"
    tiles = f"{counted(len(boxes), 'tile')} in {counted(finest + 1, 'level')}"
    return f"{tiles}; the finest: {finest_is}{depth}"


def _finest_level(posed: PosedRun, surface: SimplifiedSurface) -> int:
    """How often the map is cut in four, by its triangles and by the pixels of its surface."""
    area_m2 = (
        np.linalg.norm(
            np.cross(*np.diff(surface.position[surface.triangles], axis=1).transpose(1, 0, 2)),
            axis=1,
        ).sum()
        / 2
    )
    tiles = max(
        len(surface.triangles) / LIMITS.triangles, area_m2 / posed.pixel_m**2 / LIMITS.pixels, 1.0
    )
    return int(np.ceil(np.log2(tiles) / 2))


def _cells(
    surface: SimplifiedSurface, low: NDArray[np.float64], side_m: float, level: int
) -> NDArray[np.int64]:
    """(F,) the cell of each triangle on a grid of 2**level a side: row times that plus column."""
    center = surface.position[surface.triangles].mean(axis=1)
    column, row = ((center - low)[:, :2] / side_m * (1 << level)).astype(np.int64).T
    return np.asarray(row * (1 << level) + column)


def _uri(level: int, column: int, row: int) -> str:
    return f"tiles/{level}/{column}_{row}.glb"


def _bounds(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 3) lowest and highest, a millimeter apart at least."""
    low, high = points.min(axis=0), points.max(axis=0)
    more = np.maximum(1e-3 - (high - low), 0) / 2
    return np.stack([low - more, high + more])


def _tile(
    boxes: dict[tuple[int, int, int], NDArray[np.float64]],
    errors_m: list[float],
    key: tuple[int, int, int],
) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """A tile with those below it, and the bounds of all of them."""
    level, column, row = key
    below = [(level + 1, 2 * column + i, 2 * row + j) for j in (0, 1) for i in (0, 1)]
    children = [_tile(boxes, errors_m, child) for child in below if child in boxes]
    bounds = _bounds(np.concatenate([boxes[key], *(box for _, box in children)]))
    half = np.diag((bounds[1] - bounds[0]) / 2)
    tile: dict[str, Any] = {
        "boundingVolume": {"box": [*bounds.mean(axis=0).tolist(), *half.ravel().tolist()]},
        "geometricError": errors_m[level] if children else 0,
        "refine": "REPLACE",
        "content": {"uri": _uri(*key)},
    }
    return tile | ({"children": [child for child, _ in children]} if children else {}), bounds


def _to_earth(posed: PosedRun) -> NDArray[np.float64]:
    """(4, 4) from the map's coordinates to geocentric ones (EPSG:4978), its world's z taken as
    height above the ellipsoid; to the world's, where their place on Earth is not known.
    """
    shift = rigid_transform(np.eye(3), posed.offset_m)
    if posed.origin is None:
        return shift
    if posed.origin.utm_epsg is None:
        latitude_deg, longitude_deg = posed.origin.latitude_deg, posed.origin.longitude_deg
        axes = east_north_up_axes(latitude_deg, longitude_deg)
        return np.asarray(
            rigid_transform(axes.T, geocentric_from_geodetic(latitude_deg, longitude_deg, 0.0))
            @ shift
        )
    here, *axes_ends = (_geocentric(point, posed.origin) for point in posed.offset_m + NEAR_M)
    return rigid_transform(
        np.stack([(end - here) / NEAR_M.max() for end in axes_ends], axis=-1), here
    )


def _geocentric(point_m: NDArray[np.float64], origin: GeoOrigin) -> NDArray[np.float64]:
    x_m, y_m, z_m = (float(value) for value in point_m)
    return geocentric_from_geodetic(*degrees_from_north_east(y_m, x_m, origin), z_m)


FORMAT = ExportFormat(
    "the surface with the images on it as a tree of 3-D Tiles 1.1, georeferenced if the map is",
    "CesiumJS, QGIS",
    write,
)
