"""Positions on Earth of two surveys that show the same ground."""

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import transform_points
from stereo_seecolor.earth import degrees_from_north_east, geocentric_from_geodetic
from stereo_seecolor.records import GeoOrigin
from stereo_seecolor.run_folder.posed_run import PosedRun

FAR_M = 100.0
"""Beyond what acoustic fixes and tides differ by; another datum, zone or hemisphere is more."""


def position_note(first: PosedRun, second: PosedRun, T_a_b: NDArray[np.float64]) -> str:
    """What it means that the navigation of both has the same ground at different places; "" where
    it is near, or unknown. T_a_b: (4, 4) from the second map's own coordinates to the first's.
    """
    if first.origin is None or second.origin is None:
        return ""
    middle_m = second.T_map_camera[:, :3, 3].mean(axis=0)
    at_first = _geocentric(transform_points(T_a_b, middle_m) + first.offset_m, first.origin)
    at_second = _geocentric(middle_m + second.offset_m, second.origin)
    apart_m = float(np.linalg.norm(at_first - at_second))
    if apart_m < FAR_M:
        return ""
    return (
        f"the navigation of the two surveys puts the same ground {apart_m / 1000:,.1f} km apart: "
        "one of them is wrong (a sign, a hemisphere, a zone, another datum, a depth); all files "
        "lie where the first one says"
    )


def _geocentric(world_m: NDArray[np.float64], origin: GeoOrigin) -> NDArray[np.float64]:
    east_m, north_m, up_m = world_m.tolist()
    return geocentric_from_geodetic(*degrees_from_north_east(north_m, east_m, origin), up_m)
