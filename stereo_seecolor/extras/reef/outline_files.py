"""Reading of outlines from files: GeoJSON (QGIS, ArcGIS), and TagLab's project."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.bounded_text import decode_text, load_json
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef.outlines import Outline, Ring
from stereo_seecolor.extras.reef.polygons import cross, crosses_itself, inside
from stereo_seecolor.files.rasters import open_raster
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.mapping.raster.georeference import crs_wkt
from stereo_seecolor.run_folder.layout import MOSAIC
from stereo_seecolor.run_folder.posed_run import PosedRun

LABEL_KEYS = (
    "label", "class", "class_name", "category", "type", "species", "taxon",
    "tl_class", "classname",  # of TagLab's shapefiles, of ArcGIS's training samples
)  # fmt: skip
NAME_KEYS = ("name", "id", "fid", "tl_id", "objectid")
DEGREES_NEAR = 0.5
"""Coordinates within this of the map's place on Earth are longitude and latitude; meters of a map
are never so there by chance.
"""

LEAST_CORNERS = 3
FARTHEST = 1e9
"""Meters and degrees are less: what is more is not a coordinate."""
LOCAL_NAMES = ("local", "undefined", "unknown", "engcrs")
"""Words in the name of a system that is not a place on Earth: the map's own is meant."""
DEFAULT_NAMES = ("crs84", "4326")
"""The system of GeoJSON that names none, which programs also name without the user's doing."""
OTHERS = (
    (b"\x00\x00\x27\x0a", "a Shapefile"), (b"SQLite format 3", "a GeoPackage"), (b"PK\x03\x04",
    "an archive"), (b"<", "XML or KML")
)  # fmt: skip
OTHER_JSON = {
    ("shapes", "imageWidth"): "a file of LabelMe, in pixels",
    ("annotations", "categories"): "a data set of COCO, in pixels",
    ("geometryType", "features"): "JSON of ArcGIS",
}
"""Keys that only another kind of file has -> what it is."""

Turn = Callable[[NDArray[np.float64]], Ring]


def read_outlines(path: Path, posed: PosedRun) -> list[Outline]:
    """The polygons of a file in the map's coordinates. Raises InputError if it holds none."""
    try:
        raw = read_bytes(path)
        if kind := next((what for begin, what in OTHERS if raw.startswith(begin)), None):
            raise InputError(f"{path}: is {kind}: save the polygons as GeoJSON")
        content = load_json(decode_text(raw))
    except ValueError as error:
        raise InputError(
            f"{path}: is neither GeoJSON nor a TagLab project ({error}): save the polygons as "
            "GeoJSON"
        ) from error
    if isinstance(content, dict):
        keys = content.keys()
        if kind := next((what for own, what in OTHER_JSON.items() if {*own} <= keys), None):
            raise InputError(f"{path}: is {kind}: save the polygons as GeoJSON")
    try:
        if isinstance(content, dict) and "images" in content and "features" not in content:
            outlines = _taglab(content, posed)
        else:
            outlines = _geojson(content, posed)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{path}: is damaged, or in an unknown format ({error!r}): save the polygons as GeoJSON"
        ) from error
    if not outlines:
        raise InputError(
            f"{path}: holds no polygon: draw them on {MOSAIC} and save as GeoJSON, or give a "
            "TagLab project"
        )
    return outlines


def _parts(geometry: dict[str, Any], number: int) -> list[Any]:
    """The polygons of a geometry; none of points. Raises InputError for a line, which may be an
    outline that someone drew.
    """
    kind = geometry.get("type", "")
    if kind == "GeometryCollection":
        return [part for each in geometry["geometries"] for part in _parts(each, number)]
    if kind in ("LineString", "MultiLineString"):
        raise InputError(f"feature {number} is a line: make it a polygon, or leave it out")
    if kind not in ("Polygon", "MultiPolygon"):
        return []
    polygons = geometry["coordinates"] if kind == "MultiPolygon" else [geometry["coordinates"]]
    return [rings for rings in polygons if rings]


def _geojson(content: dict[str, Any], posed: PosedRun) -> list[Outline]:
    if not isinstance(content, dict):
        raise InputError("is a list: save the polygons as a FeatureCollection")
    bare = [content if content["type"] == "Feature" else {"geometry": content}]
    features = content["features"] if content["type"] == "FeatureCollection" else bare
    turn = _turn(content, posed)
    found = []
    for number, feature in enumerate(features, 1):
        geometry, properties = feature.get("geometry") or {}, feature.get("properties") or {}
        parts = _parts(geometry, number)
        polygons = [[_ring(ring, turn, number) for ring in part] for part in parts]
        _check_holes(polygons, number)
        if rings := tuple(ring for polygon in polygons for ring in polygon):
            name = _first(properties, NAME_KEYS) or str(feature.get("id", "")) or f"{number}"
            found.append(Outline(name, _first(properties, LABEL_KEYS), rings))
    return found


def _ring(corners: Any, turn: Turn, number: int) -> Ring:
    """In the map's coordinates. Raises InputError for what is not an outline, or not a coordinate,
    in the file or in the map.
    """
    if len(corners) < LEAST_CORNERS:
        raise InputError(f"polygon {number} has fewer than {LEAST_CORNERS} corners")
    ring = np.array(corners, np.float64)[:, :2]
    for points in (ring, known := turn(ring) if (np.abs(ring) < FARTHEST).all() else ring):
        if not (np.abs(points) < FARTHEST).all():
            raise InputError(
                f"polygon {number} has coordinates that are not numbers, or that its crs does not "
                "take to the map"
            )
    is_closed = bool((known[0] == known[-1]).all())
    if crosses_itself(known[:-1] if is_closed else known):
        raise InputError(
            f"polygon {number} crosses itself, and so has no area: move its corners apart, or draw "
            "two"
        )
    return known


def _check_holes(polygons: list[list[Ring]], number: int) -> None:
    """Raises InputError for holes that are not inside their polygon, and for rings that cross."""
    rings = [ring for polygon in polygons for ring in polygon]
    if any(cross(*both) for both in _meeting(rings)):
        raise InputError(f"polygon {number}: two of its rings cross: draw them apart")
    for outer, *holes in polygons:
        if not all(_holds(outer, hole) for hole in holes):
            raise InputError(f"polygon {number}: a hole is not inside the outline")
        if any(_holds(*both) or _holds(*both[::-1]) for both in _meeting(holes)):
            raise InputError(f"polygon {number}: a hole is inside another hole, or given twice")


def _meeting(rings: Sequence[Ring]) -> Iterator[tuple[Ring, Ring]]:
    """The pairs of rings whose boxes meet: a file may hold thousands."""
    low, high = (np.array([end(ring, axis=0) for ring in rings]) for end in (np.min, np.max))
    for i, ring in enumerate(rings):
        meet = ((low[:i] <= high[i]) & (high[:i] >= low[i])).all(axis=1)
        yield from ((ring, rings[k]) for k in np.flatnonzero(meet).tolist())


def _holds(outer: Ring, ring: Ring) -> bool:
    """Whether a ring lies inside another one, which it does not cross; corners may touch."""
    return 2 * inside(ring, outer).sum() > len(ring) or np.array_equal(outer, ring)


def _first(properties: dict[str, Any], keys: tuple[str, ...]) -> str:
    small = {key.lower(): value for key, value in properties.items()}
    return next((str(small[key]).strip() for key in keys if small.get(key) not in (None, "")), "")


def _turn(content: dict[str, Any], posed: PosedRun) -> Turn:
    """From the file's coordinates to the map's own: by its crs member, else degrees where they fall
    on the map, else meters.
    """
    member = content.get("crs") or {}
    named = member if isinstance(member, str) else (member.get("properties") or {}).get("name")
    low = str(named or "").lower()
    if any(word in low for word in LOCAL_NAMES):
        return lambda ring: ring - posed.offset_m[:2]
    if posed.origin is None:
        if low and not low.endswith(DEFAULT_NAMES):
            raise InputError(
                f"its crs {named!r:.80} is on Earth, but the map has only local meters: save the "
                "polygons in the map's own system"
            )
        return lambda ring: ring - posed.offset_m[:2]
    import pyproj

    try:
        pyproj.CRS.from_user_input(named or "OGC:CRS84")
    except pyproj.exceptions.CRSError as error:
        raise InputError(
            f"its crs {named!r:.80} is not known: save the polygons in EPSG:4326, or in the map's "
            "own system"
        ) from error
    local = crs_wkt(posed.origin)
    place = np.array([posed.origin.longitude_deg, posed.origin.latitude_deg])

    def turn(ring: NDArray[np.float64]) -> Ring:
        apart = np.abs(ring - place)
        apart[:, 0] = np.minimum(apart[:, 0], np.abs(360 - apart[:, 0]))  # over the antimeridian
        degrees = bool((apart < DEGREES_NEAR).all())
        if not named and not degrees:
            return np.asarray(ring - posed.offset_m[:2])
        x, y = pyproj.Transformer.from_crs(named or "OGC:CRS84", local, always_xy=True).transform(
            *ring.T
        )
        return np.stack([x, y], axis=-1) - posed.offset_m[:2]

    return turn


def _taglab(content: dict[str, Any], posed: PosedRun) -> list[Outline]:
    """Regions of the image of the size of the orthomosaic.

    Contours are x, y in pixels, or as TagLab writes them now: one text of tenths of a pixel, each
    corner from the one before.
    """
    with open_raster(posed.map_folder / MOSAIC) as file:
        size, transform = (file.width, file.height), file.transform
    images = [
        image for image in content["images"] if (image.get("width"), image.get("height")) == size
    ]
    if not images:
        raise ValueError(f"no image of {size[0]} x {size[1]} px, the size of {MOSAIC}")

    def turn(ring: str | list[Any]) -> Ring:
        numbers = np.array(ring.split() if isinstance(ring, str) else ring, np.float64)
        px = numbers if numbers.ndim > 1 else numbers.reshape(-1, 2).cumsum(axis=0) / 10
        # north is up
        corner, scale = (np.array([transform.c, transform.f]), np.array([transform.a, transform.e]))
        return np.asarray(corner + scale * (px[:, :2] + 0.5) - posed.offset_m[:2])

    found = [image["annotations"] for image in images]  # a list of regions in older projects
    regions = [
        one for each in found for one in (each if isinstance(each, list) else each["regions"])
    ]
    return [
        Outline(
            f"{each['id']}",
            str(each["class name"]),
            tuple(map(turn, [each["contour"], *each.get("inner contours", [])])),
        )
        for each in regions
    ]
