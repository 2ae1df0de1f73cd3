"""Coordinates of a map: meters around its origin, its UTM zone, or meters that lie nowhere."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from mapping_scene import CONFIG, PAIR, flat_frame, track, write_run

from calibration.transforms import transform_points
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.config import RunConfig
from stereo_seecolor.earth import degrees_from_north_east, geodetic_from_geocentric
from stereo_seecolor.errors import DeviceError, MappingError
from stereo_seecolor.extras.export import tiles_3d
from stereo_seecolor.extras.reef.markers import open_posed_run
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.georeference import crs_name, crs_wkt, in_utm, utm_of
from stereo_seecolor.mapping.survey_map import build_map, check
from stereo_seecolor.records import GeoOrigin

ORIGIN = GeoOrigin(-23.5, 152.0)
TO_UTM = pyproj.Transformer.from_crs(crs_wkt(ORIGIN), 32756, always_xy=True)


def test_poses_in_utm_lie_and_head_where_the_zone_says() -> None:
    T = track(3, step_m=400.0).T_world_camera
    moved = in_utm(T, ORIGIN)
    for at in ([0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0]):
        for before, after in zip(T, moved, strict=True):
            x, y, z = transform_points(before, np.array(at))
            np.testing.assert_allclose(
                transform_points(after, np.array(at)), [*TO_UTM.transform(x, y), z], atol=5e-4
            )
    lost = np.concatenate([T, np.full((1, 4, 4), np.nan)])
    assert np.isnan(in_utm(lost, ORIGIN)[3]).all() and np.isfinite(in_utm(lost, ORIGIN)[:3]).all()
    x, y = moved[2, :2, 3]
    expected = degrees_from_north_east(float(T[2, 1, 3]), float(T[2, 0, 3]), ORIGIN)
    assert degrees_from_north_east(y, x, utm_of(ORIGIN)) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("place", "zone"), [((-23.5, 152.0), 32756), ((10.0, -179.99), 32601), ((0.0, 180.0), 32601)]
)
def test_the_zone_is_that_of_the_place(place: tuple[float, float], zone: int) -> None:
    assert utm_of(GeoOrigin(*place)).utm_epsg == zone
    assert crs_name(utm_of(GeoOrigin(*place))).startswith(
        f"EPSG:{zone} (WGS84, UTM zone {zone % 100}"
    )


def test_the_projection_around_the_origin_has_a_name() -> None:
    """GIS programs list it by this name, and QGIS calls one without a name unknown."""
    crs = pyproj.CRS.from_wkt(crs_wkt(ORIGIN))
    assert (crs.name, crs.geodetic_crs.name) == ("Meters around -23.500000, 152.000000", "WGS 84")
    assert "unknown" not in rasterio.CRS.from_wkt(crs.to_wkt()).to_wkt()
    proj4 = "+proj=tmerc +lat_0=-23.5 +lon_0=152 +k=1 +datum=WGS84 +units=m +type=crs"
    to_proj4 = pyproj.Transformer.from_crs(crs, proj4, always_xy=True)
    assert to_proj4.transform(1000.0, 2000.0) == pytest.approx((1000.0, 2000.0), abs=1e-6)


def test_utm_needs_a_place_on_earth(monkeypatch: pytest.MonkeyPatch) -> None:
    config = CONFIG.model_copy(update={"crs": "utm"})
    with pytest.raises(
        MappingError, match=r"mapping\.crs: utm: there are no poses: give --poses with latitude"
    ):
        check(config, None)
    with pytest.raises(MappingError, match="the poses have no position on Earth"):
        check(config, track(3))
    check(config, replace(track(3), origin=ORIGIN))
    monkeypatch.setattr(georeference, "available", lambda: False)
    with pytest.raises(
        DeviceError, match=r"needs pyproj, rasterio and laspy: pip install 'stereo-seecolor\[geo\]'"
    ):
        check(config, replace(track(3), origin=ORIGIN))


@pytest.mark.slow
def test_all_products_of_a_map_in_utm_agree_and_its_export_lies_on_the_globe(
    tmp_path: Path,
) -> None:
    import laspy

    plain = replace(track(3), origin=ORIGIN)
    write_run(tmp_path / "out", [flat_frame(i) for i in range(3)], PAIR)
    write_tum(tmp_path / "nav.tum", plain)
    fuse(
        tmp_path / "out",
        tmp_path / "nav.tum",
        RunConfig(mapping=CONFIG.model_copy(update={"poses": "given"})),
    )
    folder = tmp_path / "out" / "map"
    for path in folder.iterdir():
        path.unlink()
    build_map(
        [flat_frame(i) for i in range(3)],
        PAIR,
        folder,
        CONFIG.model_copy(update={"crs": "utm"}),
        plain,
    )
    with rasterio.open(folder / "dem.tif") as dem:
        assert dem.crs.to_epsg() == 32756
        west, north = dem.bounds.left, dem.bounds.top
    np.testing.assert_allclose([west, north], TO_UTM.transform(-0.6, 0.48), atol=0.06)
    with laspy.open(folder / "cloud.laz") as file:
        assert file.header.parse_crs().to_epsg() == 32756
        np.testing.assert_allclose(file.header.mins[0], west, atol=0.05)
    header = (folder / "cloud.ply").read_bytes()[:600].decode(errors="replace")
    offset_m = json.loads((folder / "map.json").read_text())["offset_m"]
    assert (
        "comment crs EPSG:32756" in header
        and f"comment offset {offset_m[0]:.3f} {offset_m[1]:.3f}" in header
    )
    posed = open_posed_run(tmp_path / "out")
    tiles_3d.write(posed, tmp_path)
    tileset = json.loads((tmp_path / "tileset.json").read_text())
    assert tileset["asset"]["extras"]["crs"].startswith("EPSG:32756")
    T = np.array(tileset["root"]["transform"]).reshape(4, 4).T
    local = posed.T_map_camera[2, :3, 3]
    latitude, longitude, height = geodetic_from_geocentric(transform_points(T, local))
    expected = degrees_from_north_east(0.0, 0.6, ORIGIN)
    assert ((latitude, longitude), height) == (
        pytest.approx(expected, abs=1e-8),
        pytest.approx(1.5, abs=0.002),
    )


@pytest.mark.slow
def test_a_local_map_names_no_place(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"crs": "local"})
    summary = build_map(
        [flat_frame(i) for i in range(2)], PAIR, tmp_path, config, replace(track(2), origin=ORIGIN)
    )
    assert "cloud.laz" not in {path.name for path in summary.files}
    assert json.loads((tmp_path / "map.json").read_text())["origin"] is None
    with rasterio.open(tmp_path / "dem.tif") as dem:
        assert dem.crs.to_wkt().startswith("LOCAL_CS") and dem.units == ("m",)
    header = (tmp_path / "mesh.ply").read_bytes()[:400]
    assert b"comment crs local meters, no position on Earth" in header


@pytest.mark.slow
@pytest.mark.skipif(
    not shutil.which("gdalinfo"), reason="GDAL is not installed (Debian: apt-get install gdal-bin)"
)
def test_gdal_reads_terrain_and_mosaic(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"crs": "utm"})
    build_map(
        [flat_frame(i) for i in range(2)], PAIR, tmp_path, config, replace(track(2), origin=ORIGIN)
    )
    for name, bands, cell_m in (
        ("dem.tif", 1, config.dem_m),
        ("orthomosaic.tif", 4, config.mosaic_m),
    ):
        done = subprocess.run(
            ["gdalinfo", "-json", "-stats", name], cwd=tmp_path, capture_output=True, check=True
        )
        found = json.loads(done.stdout)
        with rasterio.open(tmp_path / name) as raster:
            assert found["size"] == [raster.width, raster.height]
        assert len(found["bands"]) == bands
        assert "32756" in found["coordinateSystem"]["wkt"]
        np.testing.assert_allclose(found["geoTransform"][1], cell_m, rtol=1e-6)
        center = found["cornerCoordinates"]["center"]
        np.testing.assert_allclose(center, TO_UTM.transform(0.15, 0.0), atol=0.1)
        if bands == 1:
            assert found["bands"][0]["noDataValue"] == "NaN" or np.isnan(
                float(found["bands"][0]["noDataValue"])
            )
