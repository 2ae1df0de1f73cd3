"""Positions on Earth (WGS 84): degrees and meters, geocentric coordinates, and axes."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stereo_seecolor.records import GeoOrigin

_STEPS = 8
"""Of an iteration that gains two digits a step over a few kilometers."""

_SEMI_MAJOR_M = 6378137.0  # of WGS 84
_ECCENTRICITY_SQUARED = 0.00669437999014  # of WGS 84

R_ENU_NED = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
"""From axes north, east, down to east, north, up."""


def north_east_from_degrees(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, origin: GeoOrigin
) -> NDArray[np.float64]:
    """Convert to meters north and east of the origin, (N, 2): transverse Mercator at the origin, to
    second order in longitude.

    Snyder, Map Projections (USGS 1395), eqs. 8-9 and 8-10; within 1 mm over a kilometer.
    """
    latitude, longitude = (
        np.radians(np.asarray(latitude_deg, np.float64)),
        np.asarray(longitude_deg, np.float64),
    )
    latitude_0 = np.radians(origin.latitude_deg)
    d_longitude = np.radians(within_180(longitude - origin.longitude_deg))
    meridian_m = (
        _SEMI_MAJOR_M * (1 - _ECCENTRICITY_SQUARED) / _flattened((latitude + latitude_0) / 2) ** 1.5
    )
    prime_vertical_m = _SEMI_MAJOR_M / np.sqrt(_flattened(latitude))
    east = prime_vertical_m * np.cos(latitude) * d_longitude
    north = (latitude - latitude_0) * meridian_m + east * np.sin(latitude) * d_longitude / 2
    return np.stack([north, east], axis=-1)


def within_180(angle_deg: ArrayLike) -> NDArray[np.float64]:
    """The same angles from -180 up to, but not including, 180 degrees."""
    return np.asarray((np.asarray(angle_deg, np.float64) + 180) % 360 - 180)


def degrees_from_north_east(
    north_m: float, east_m: float, origin: GeoOrigin
) -> tuple[float, float]:
    """Latitude and longitude (-180 to 180) of a point of a map: the inverse of
    ``north_east_from_degrees``, or of the map's UTM zone.
    """
    if origin.utm_epsg:
        import pyproj  # a map in UTM was made with it

        longitude, latitude = pyproj.Transformer.from_crs(
            origin.utm_epsg, "OGC:CRS84", always_xy=True
        ).transform(east_m, north_m)
        return float(latitude), float(longitude)
    latitude_deg, longitude_deg = origin.latitude_deg, origin.longitude_deg
    latitude_0 = np.radians(origin.latitude_deg)
    radius_m = _SEMI_MAJOR_M / np.sqrt(_flattened(latitude_0))
    for _ in range(_STEPS):
        north, east = north_east_from_degrees(latitude_deg, longitude_deg, origin)
        latitude_deg += float(np.degrees((north_m - north) / radius_m))
        longitude_deg += float(np.degrees((east_m - east) / (radius_m * np.cos(latitude_0))))
    return latitude_deg, float(within_180(longitude_deg))


def _flattened(latitude: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)


def geodetic_from_geocentric(position_m: NDArray[np.float64]) -> tuple[float, float, float]:
    """Latitude and longitude in degrees and height in meters (WGS84) of one point (3,), by
    Bowring's formula (1976).

    Within 1e-6 m up to 10 km above or below the ellipsoid.
    """
    x, y, z = position_m
    semi_minor_m = _SEMI_MAJOR_M * np.sqrt(1 - _ECCENTRICITY_SQUARED)
    from_axis_m = np.hypot(x, y)
    reduced = np.arctan2(z * _SEMI_MAJOR_M, from_axis_m * semi_minor_m)
    second_eccentricity_squared = _ECCENTRICITY_SQUARED / (1 - _ECCENTRICITY_SQUARED)
    latitude = np.arctan2(
        z + second_eccentricity_squared * semi_minor_m * np.sin(reduced) ** 3,
        from_axis_m - _ECCENTRICITY_SQUARED * _SEMI_MAJOR_M * np.cos(reduced) ** 3,
    )
    prime_vertical_m = _SEMI_MAJOR_M / np.sqrt(_flattened(latitude))
    height_m = (
        from_axis_m * np.cos(latitude) + z * np.sin(latitude) - _SEMI_MAJOR_M**2 / prime_vertical_m
    )
    return float(np.degrees(latitude)), float(np.degrees(np.arctan2(y, x))), float(height_m)


def geocentric_from_geodetic(
    latitude_deg: float, longitude_deg: float, height_m: float
) -> NDArray[np.float64]:
    """Convert latitude and longitude in degrees and height in meters (WGS84) to geocentric meters
    (3,): the inverse of the above.
    """
    latitude, longitude = np.radians(np.float64(latitude_deg)), np.radians(longitude_deg)
    prime_vertical_m = _SEMI_MAJOR_M / np.sqrt(_flattened(latitude))
    from_axis_m = (prime_vertical_m + height_m) * np.cos(latitude)
    z = (prime_vertical_m * (1 - _ECCENTRICITY_SQUARED) + height_m) * np.sin(latitude)
    return np.array([from_axis_m * np.cos(longitude), from_axis_m * np.sin(longitude), z])


def east_north_up_axes(latitude_deg: float, longitude_deg: float) -> NDArray[np.float64]:
    """The directions east, north and up in geocentric axes, as rows: (3, 3)."""
    (sin_lat, cos_lat), (sin_lon, cos_lon) = (
        (np.sin(angle), np.cos(angle)) for angle in np.radians([latitude_deg, longitude_deg])
    )
    return np.array(
        [
            [-sin_lon, cos_lon, 0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
