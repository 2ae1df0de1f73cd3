"""Georeferenced files of a map, and its coordinate reference system; needs the ``geo`` extra."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import rotation_from_vector
from stereo_seecolor.files.atomic import atomic_path
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.mapping.raster.block_raster import BlockRaster
from stereo_seecolor.records import GeoOrigin

HEIGHTS = "height_m"
"""Description of a band of heights, which are in the map's own coordinates."""
NORTH, SOUTH = 32600, 32700
"""EPSG numbers of WGS 84's UTM zones, less the zone."""
CHUNK = 1_000_000
"""Points at a time: 27 MB."""
SPARSE_FROM_PIXELS = 2**30
"""More than OpenCV and Pillow open. They do not open sparse files at all, and blocks without a
surface take 16 MB up to here.
"""


LOCAL_WKT = (
    'LOCAL_CS["local '
    'meters",UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)
"""Of a map without a place on Earth: programs that draw on it need a system in meters."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """The place of a map's local coordinates: their offset in the world, offset_m (3,), and the
    world's origin on Earth, None if unknown.
    """

    offset_m: NDArray[np.float64]
    origin: GeoOrigin | None


def crs_name(origin: GeoOrigin | None) -> str:
    """Describe the map's coordinate reference system in words."""
    if origin is None:
        return "local meters, no position on Earth"
    if origin.utm_epsg:
        return (
            f"EPSG:{origin.utm_epsg} (WGS84, UTM zone "
            f"{origin.utm_epsg % 100}{'N' if origin.utm_epsg < SOUTH else 'S'})"
        )
    return (
        f"transverse Mercator around latitude {origin.latitude_deg:.9f}, longitude "
        f"{origin.longitude_deg:.9f} (WGS84), scale 1"
    )


def available() -> bool:
    """Tell whether rasterio, pyproj and laspy can be imported."""
    try:
        import laspy  # noqa: F401
        import pyproj  # noqa: F401
        import rasterio  # noqa: F401
    except (ImportError, OSError):
        return False
    return True


def crs_wkt(origin: GeoOrigin) -> str:
    """Give the WKT of the map's UTM zone, or of transverse Mercator around the map's origin at
    scale 1: its own meters, north up.

    The latter is the convention of ACFR's stereo_pose_est.data. UTM shrinks lengths by up to 0.04 %
    and turns north by up to 3 degrees.
    """
    import pyproj
    from pyproj.crs.coordinate_operation import TransverseMercatorConversion

    if origin.utm_epsg:
        return str(pyproj.CRS.from_epsg(origin.utm_epsg).to_wkt())
    around = TransverseMercatorConversion(origin.latitude_deg, origin.longitude_deg)
    name = f"Meters around {origin.latitude_deg:.6f}, {origin.longitude_deg:.6f}"
    return str(pyproj.crs.ProjectedCRS(around, name, geodetic_crs=4326).to_wkt())


def utm_of(origin: GeoOrigin) -> GeoOrigin:
    """Give the same origin with the EPSG number of its UTM zone."""
    zone = int((origin.longitude_deg + 180) % 360 // 6) + 1
    return replace(origin, utm_epsg=(NORTH if origin.latitude_deg >= 0 else SOUTH) + zone)


def in_utm(T_world_camera: NDArray[np.float64], origin: GeoOrigin) -> NDArray[np.float64]:
    """Transform poses (N, 4, 4) in meters around the origin into its UTM zone, each turned by the
    meridian convergence at its place.

    What a frame saw keeps its true size: between frames UTM is up to 0.04 % shorter, a millimeter
    over two meters.
    """
    import pyproj

    turn = pyproj.Transformer.from_crs(
        crs_wkt(origin), utm_of(origin).utm_epsg, always_xy=True
    ).transform
    known = np.isfinite(T_world_camera[:, 0, 3])
    position = T_world_camera[known, :3, 3]
    (east, north), beside = turn(*position[:, :2].T), turn(position[:, 0] + 1, position[:, 1])
    convergence = np.arctan2(np.asarray(beside[1]) - north, np.asarray(beside[0]) - east)
    T = T_world_camera.copy()
    T[known, :3, :3] = (
        rotation_from_vector(convergence[:, None] * [0.0, 0.0, 1.0]) @ T[known, :3, :3]
    )
    T[known, 0, 3], T[known, 1, 3] = east, north
    return T


def write_geotiff(
    path: Path, raster: BlockRaster, place: Georeference, descriptions: tuple[str, ...] = ()
) -> Path:
    """Write a raster as a tiled, compressed GeoTIFF with overviews: float32 with NaN as nodata,
    uint8 RGBA with alpha, or one band of uint8 codes with 0 as nodata; return the path.

    Coordinates are the world's; without an origin on Earth they are its meters, in a local system.
    """
    import rasterio
    from rasterio.enums import ColorInterp, Resampling

    grid, floating = raster.grid, raster.dtype == np.float32
    codes = not floating and raster.bands == 1
    west_m = grid.west_m + float(place.offset_m[0])
    north_m = grid.north_m + float(place.offset_m[1])
    profile = {
        "driver": "GTiff", "dtype": raster.dtype, "count": raster.bands, "height": grid.shape[0],
        "width": grid.shape[1],
        "tiled": True, "blockxsize": 256, "blockysize": 256, "compress": "deflate",
        "predictor": 2,  # that of floating point needs imagecodecs in tifffile
        "zlevel": 1,  # a quarter of the time of the usual 6, files 2 to 4 % larger
        "bigtiff": "if_safer", "sparse_ok": grid.shape[0] * grid.shape[1] > SPARSE_FROM_PIXELS,
        "crs": crs_wkt(place.origin) if place.origin else LOCAL_WKT,
        "transform": rasterio.Affine(grid.cell_m, 0, west_m, 0, -grid.cell_m, north_m),
        "nodata": np.nan if floating else 0 if codes else None,
    }  # fmt: skip
    with atomic_path(path) as temporary:
        with rasterio.open(temporary, "w", **profile) as file:
            for rows, columns in raster.windows():
                file.write(
                    raster.read(rows, columns),
                    window=((rows.start, rows.stop), (columns.start, columns.stop)),
                )
            if not floating and not codes:
                file.colorinterp = [
                    ColorInterp.red,
                    ColorInterp.green,
                    ColorInterp.blue,
                    ColorInterp.alpha,
                ]
            for band, description in enumerate(descriptions, start=1):
                file.set_band_description(band, description)
                if description.endswith("_m"):
                    file.set_band_unit(band, "m")
            if (
                HEIGHTS in descriptions and place.offset_m[2]
            ):  # of a map deep in the sea: GDAL and QGIS add it
                file.offsets = [float(place.offset_m[2]) * (d == HEIGHTS) for d in descriptions]
        factors = [f for f in (2, 4, 8, 16, 32) if min(grid.shape) // f >= 128]
        if factors:
            with rasterio.open(temporary, "r+") as file:
                file.build_overviews(factors, Resampling.mode if codes else Resampling.average)
    return path


def write_laz(path: Path, cloud: Path, place: Georeference) -> Path:
    """Write the cloud as LAZ in the coordinate system of the GeoTIFFs, in millimeters with an
    offset near the map; return the path.

    cloud: the PLY file, read in pieces.
    """
    import laspy
    import pyproj

    assert place.origin is not None, "a cloud without a position on Earth has no coordinate system"
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = np.full(3, 0.001)
    header.offsets = np.array([*np.floor(place.offset_m[:2]), 0.0])
    header.add_crs(pyproj.CRS.from_wkt(crs_wkt(place.origin)))
    vertices = read_vertices(cloud)
    with (
        atomic_path(path) as temporary,
        temporary.open("wb") as target,
        laspy.open(target, mode="w", header=header, do_compress=True) as file,
    ):
        for start in range(0, len(vertices), CHUNK):
            part = vertices[start : start + CHUNK]
            points = laspy.ScaleAwarePointRecord.zeros(len(part), header=header)
            position = np.asarray(part["position"], np.float64) + place.offset_m
            points.x, points.y, points.z = position.T
            points.red, points.green, points.blue = (
                part["color"][:, c].astype(np.uint16) * 257 for c in range(3)
            )
            file.write_points(points)
    return path
