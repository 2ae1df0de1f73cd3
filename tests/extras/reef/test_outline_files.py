"""Polygons as other programs save them: systems that are local or not known, numbers that are none,
files of other formats.
"""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef import outline_files
from stereo_seecolor.extras.reef.outline_files import read_outlines
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.records import GeoOrigin

RING = [[0.5, 0.2], [1.2, 0.2], [1.2, 0.8], [0.5, 0.2]]
POSED: Any = SimpleNamespace(
    origin=GeoOrigin(-14.685, 145.46), offset_m=np.array([10.0, 20.0, 0.0]), map_folder=Path("map")
)


def geojson(path: Path, ring: list[list[float]], name: str | None = None) -> Path:
    crs = {"crs": {"type": "name", "properties": {"name": name}}} if name is not None else {}
    feature = {
        "type": "Feature",
        "properties": {"label": " P "},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", **crs, "features": [feature]}))
    return path


@pytest.mark.parametrize(
    "name",
    [
        'LOCAL_CS["Local Coordinates (m)",UNIT["meter",1]]', 'ENGCRS["Local"]',
        "Undefined Cartesian SRS with unknown unit",
        "local", "", None,
    ],
)  # fmt: skip
def test_a_local_system_is_the_maps_own(name: str | None, tmp_path: Path) -> None:
    (outline,) = read_outlines(geojson(tmp_path / "p.geojson", RING, name), POSED)
    np.testing.assert_allclose(outline.rings[0], np.array(RING) - [10, 20])


def test_a_system_that_is_no_member_but_a_name_is_read(tmp_path: Path) -> None:
    path = geojson(tmp_path / "p.geojson", RING, "local")
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"crs": "local"}))
    (outline,) = read_outlines(path, POSED)
    np.testing.assert_allclose(outline.rings[0], np.array(RING) - [10, 20])


def test_a_system_on_earth_does_not_fit_a_local_map(tmp_path: Path) -> None:
    """Programs name the default of GeoJSON themselves."""
    local: Any = SimpleNamespace(origin=None, offset_m=POSED.offset_m)
    with pytest.raises(InputError, match="its crs 'EPSG:32755' is on Earth, but the map has only"):
        read_outlines(geojson(tmp_path / "p.geojson", RING, "EPSG:32755"), local)
    for name in ("urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", 'ENGCRS["Local"]', None):
        (outline,) = read_outlines(geojson(tmp_path / "p.geojson", RING, name), local)
        np.testing.assert_allclose(outline.rings[0], np.array(RING) - [10, 20])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["urn:ogc:def:crs:EPSG::99999", "EPSG:wrong", "my system"])
def test_a_system_that_is_not_known_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=rf"p\.geojson: its crs '{name}' is not known: save the polygons in EPSG:4326",
    ):
        read_outlines(geojson(tmp_path / "p.geojson", RING, name), POSED)


@pytest.mark.parametrize(
    "ring", [[[float("nan"), 0.2], [1, 0], [1, 1]], [[1e300, 0], [1, 0], [1, 1]]]
)
@pytest.mark.parametrize("name", [None, "ESRI:102100"])
def test_what_is_no_coordinate_is_refused(
    ring: list[list[float]], name: str | None, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="polygon 1 has coordinates that are not numbers"):
        read_outlines(geojson(tmp_path / "p.geojson", ring, name), POSED)


@pytest.mark.parametrize(
    ("ring", "message"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]], "polygon 1 crosses itself"),
        ([[0, 0], [1, 1]], "polygon 1 has fewer than 3 corners"),
        ([], "polygon 1 has fewer than 3 corners"),
    ],
)
def test_what_is_no_outline_is_refused(
    ring: list[list[float]], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        read_outlines(geojson(tmp_path / "p.geojson", ring), POSED)


SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]]


def square(x: float, y: float, edge: float) -> list[list[float]]:
    return [[x + edge * a / 4, y + edge * b / 4] for a, b in SQUARE]


@pytest.mark.parametrize(
    ("rings", "message"),
    [
        ([SQUARE, square(3, 1, 2)], "polygon 1: two of its rings cross"),
        ([SQUARE, square(6, 0, 1)], "polygon 1: a hole is not inside the outline"),
        ([square(1, 1, 1), SQUARE], "polygon 1: a hole is not inside the outline"),
        ([SQUARE, square(1, 1, 2), square(1.5, 1.5, 1)], "inside another hole, or given twice"),
        ([SQUARE, square(1, 1, 2), square(1, 1, 2)], "inside another hole, or given twice"),
    ],
)
def test_holes_that_are_none_are_refused(
    rings: list[list[list[float]]], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "p.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    with pytest.raises(InputError, match=message):
        read_outlines(path, POSED)


def test_holes_and_parts_inside_holes_are_read(tmp_path: Path) -> None:
    path = tmp_path / "p.geojson"
    rings = [SQUARE, square(1, 1, 2), square(0, 3, 1)]  # touches the outline
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    assert len(read_outlines(path, POSED)[0].rings) == 3
    parts = [[SQUARE, square(1, 1, 2)], [square(1.5, 1.5, 1)]]
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": parts}))
    assert len(read_outlines(path, POSED)[0].rings) == 3


def test_parts_far_apart_are_not_compared_side_by_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: list[int] = []
    monkeypatch.setattr(outline_files, "cross", lambda *_: bool(compared.append(1)))
    parts = [[square(5 * k, 0, 4)] for k in range(200)]  # of a layer that was dissolved by class
    path = tmp_path / "p.geojson"
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": parts}))
    assert len(read_outlines(path, POSED)[0].rings) == 200
    assert not compared


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_files_of_windows_editors_are_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "p.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [SQUARE]}), encoding=encoding)
    assert len(read_outlines(path, POSED)) == 1


def test_spaces_around_a_label_do_not_make_another_label(tmp_path: Path) -> None:
    assert read_outlines(geojson(tmp_path / "p.geojson", RING), POSED)[0].label == "P"


def test_a_polygon_with_hundreds_of_holes_covers_what_lies_between_them(tmp_path: Path) -> None:
    holes = [square(10 * i + 3, 10 * k + 3, 4) for i in range(30) for k in range(30)]
    path = tmp_path / "p.geojson"
    rings = [square(0, 0, 300), *holes]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    posed: Any = SimpleNamespace(origin=None, offset_m=np.zeros(3))
    (outline,) = read_outlines(path, posed)
    expected = np.ones((300, 300), bool)
    expected.reshape(30, 10, 30, 10)[:, 3:7, :, 3:7] = False
    assert (outline.mask(Grid(0.0, 300.0, 1.0, (300, 300))) == expected).all()
    assert len(outline.rings) == 901


def test_a_polygon_without_a_feature_around_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "p.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [RING]}))
    (outline,) = read_outlines(path, POSED)
    np.testing.assert_allclose(outline.rings[0], np.array(RING) - [10, 20])
    path.write_text(json.dumps([{"type": "Polygon", "coordinates": [RING]}]))
    with pytest.raises(InputError, match="is a list"):
        read_outlines(path, POSED)


def test_polygons_of_another_place_are_far_off_or_refused_and_never_warn(tmp_path: Path) -> None:
    path = geojson(tmp_path / "p.geojson", RING, "ESRI:102100")
    try:
        (outline,) = read_outlines(path, POSED)
    except InputError as error:
        assert "its crs does not take to the map" in str(error)
    else:
        assert np.linalg.norm(outline.rings[0], axis=1).min() > 1e6
        assert not outline.mask(Grid(0.0, 1.0, 0.01, (100, 100))).any()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x00\x00\x27\x0a" + bytes(96), "is a Shapefile: save the polygons as GeoJSON"),
        (b"SQLite format 3\x00" + bytes(96), "is a GeoPackage"),
        (b"PK\x03\x04" + bytes(96), "is an archive"),
        (b"<kml></kml>", "is XML or KML"),
        (b"[" * 100_000, "is neither GeoJSON"),
    ],
)
def test_other_formats_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "p.shp").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_outlines(tmp_path / "p.shp", POSED)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"shapes": [], "imageWidth": 9}, "a file of LabelMe, in pixels"),
        ({"images": [], "annotations": [], "categories": []}, "a data set of COCO, in pixels"),
        ({"geometryType": "esriGeometryPolygon", "features": []}, "JSON of ArcGIS"),
    ],
)
def test_files_of_other_programs_are_named(
    content: dict[str, object], said: str, tmp_path: Path
) -> None:
    (tmp_path / "p.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"p.json: is {said}: save the polygons as GeoJSON"):
        read_outlines(tmp_path / "p.json", POSED)
