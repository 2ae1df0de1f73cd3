"""Catalog entries of geodata: a dive as an item of a SpatioTemporal Asset Catalog (STAC 1.0.0), and
several dives as a collection.
"""

import json
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calibration.errors import counted
from stereo_seecolor.earth import degrees_from_north_east, within_180
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.run_folder.finished_map import FinishedMap, open_map
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run
from stereo_seecolor.run_folder.layout import (
    CLOUD,
    FRAMES_TABLE,
    INDEX,
    MAP,
    MESH,
    MOSAIC,
    RUN,
    TERRAIN,
    WATER,
)
from stereo_seecolor.run_folder.posed_run import PosedRun

VERSION = "1.0.0"
COLLECTION = "collection.json"
UNDATED = "stereo-seecolor:undated"
"""The property of an item whose times are those of processing."""
ASSETS: dict[str, tuple[str, str]] = {
    INDEX: ("text/html", "the page of the run"),
    FRAMES_TABLE: ("text/csv", "a row for each pair"),
    RUN: ("application/json", "settings, inputs, versions"),
    WATER: ("application/json", "the fitted water"),
    f"{MAP}/{MOSAIC}": ("image/tiff; application=geotiff", "orthomosaic"),
    f"{MAP}/{TERRAIN}": ("image/tiff; application=geotiff", "heights"),
    f"{MAP}/{CLOUD}": ("application/octet-stream", "point cloud, PLY"),
    f"{MAP}/{MESH}": ("application/octet-stream", "mesh, PLY"),
}
"""File in OUT -> media type, what it is."""


def write(posed: PosedRun, folder: Path) -> None:
    """``item_file``, the item of the run, which names its files, and COLLECTION."""
    root = posed.run.root.resolve()
    one = item(root, root.name, folder.resolve())
    for name, content in (
        (item_file(root.name), one),
        (COLLECTION, collection([one], root.name)),
    ):
        (folder / name).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def item_file(name: str) -> str:
    """The file of an item, beside COLLECTION: another one, also where case does not count."""
    return f"{name}{'_item' if name.casefold() == 'collection' else ''}.json"


def item(out: Path, name: str, folder: Path) -> dict[str, Any]:
    """The item of the run in ``out``, for a file in ``folder``. Raises InputError if ``out`` holds
    no run, or a damaged map.

    geometry is the place on Earth of a georeferenced map; else null, as STAC prescribes.
    """
    run, made = open_run(out), open_map(out)
    box = _box(made) if made else None
    there = {path: about for path, about in ASSETS.items() if (out / path).is_file()}
    times = _times(run)
    what = f"{counted(len(run.frames), 'frame')} of a stereo camera, corrected for the water"
    if times.get(UNDATED):
        what += "; the times are those of processing, since the frames tell no date"
    up = [
        {"rel": kind, "href": COLLECTION, "type": "application/json"}
        for kind in ("collection", "parent", "root")
    ]
    return {
        "type": "Feature",
        "stac_version": VERSION,
        "id": name,
        "geometry": _polygon(box) if box else None,
        **({"bbox": box} if box else {}),
        "properties": {**times, "title": name, "description": what},
        "links": up,
        "collection": "dives",
        "assets": {
            path: {
                "href": Path(os.path.relpath(out / path, folder)).as_posix(),
                "type": kind,
                "title": what,
            }
            for path, (kind, what) in there.items()
        },
    }


def collection(items: Sequence[dict[str, Any]], title: str) -> dict[str, Any]:
    """The collection of these items."""
    boxes = [one["bbox"] for one in items if "bbox" in one]
    whole = _around(boxes) if boxes else None
    times = sorted(
        one["properties"][key]
        for one in items
        for key in ("start_datetime", "end_datetime")
        if not one["properties"].get(UNDATED)
    )
    return {
        "type": "Collection",
        "stac_version": VERSION,
        "id": "dives",
        "title": title,
        "description": f"{counted(len(items), 'dive')} of a stereo camera",
        "license": "other",
        "extent": {
            "spatial": {"bbox": [whole or [-180.0, -90.0, 180.0, 90.0]]},
            "temporal": {"interval": [[times[0], times[-1]] if times else [None, None]]},
        },
        "links": [
            {"rel": "item", "href": item_file(one["id"]), "type": "application/geo+json"}
            for one in items
        ],
    }


def _times(run: FinishedRun) -> dict[str, str | bool | None]:
    """When the frames were taken; when they were processed, where they tell no date, since an item
    must have a time.
    """
    taken = [frame.taken for frame in run.frames if frame.taken]
    times = taken or [datetime.fromisoformat(run.made)]
    first, last = (
        time.astimezone(UTC).isoformat(timespec="milliseconds") for time in (min(times), max(times))
    )
    return {
        "datetime": None,
        "start_datetime": first.replace("+00:00", "Z"),
        "end_datetime": last.replace("+00:00", "Z"),
        **({} if taken else {UNDATED: True}),
    }


def _box(made: FinishedMap) -> list[float] | None:
    """West, south, east, north of the track, degrees; None for a map without place on Earth."""
    if made.origin is None or not made.track:
        return None
    origin = made.origin
    places = [degrees_from_north_east(point.y_m, point.x_m, origin) for point in made.track]
    return _around([[longitude, latitude] * 2 for latitude, longitude in places])


def _around(boxes: Sequence[Sequence[float]]) -> list[float]:
    """The box around boxes that lie near each other; its east is less than its west if it crosses
    the antimeridian (RFC 7946, 5.2).
    """
    west, south, east, north = np.array(boxes).T
    from_first = west[0] + within_180(west - west[0])
    low, high = from_first.min(), (from_first + (east - west) % 360).max()
    return [float(within_180(low)), float(south.min()), float(within_180(high)), float(north.max())]


def _polygon(box: Sequence[float]) -> dict[str, Any]:
    """Two polygons if the box crosses the antimeridian (RFC 7946, 3.1.9)."""
    west, south, east, north = box
    parts = [
        [[[w, south], [e, south], [e, north], [w, north], [w, south]]]
        for w, e in ([(west, east)] if west <= east else [(west, 180.0), (-180.0, east)])
    ]
    if len(parts) == 1:
        return {"type": "Polygon", "coordinates": parts[0]}
    return {"type": "MultiPolygon", "coordinates": parts}


FORMAT = ExportFormat(
    "an item and a collection that name the run's files, STAC 1.0.0", "STAC catalogs, QGIS", write
)
