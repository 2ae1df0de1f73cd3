"""From disparity to depth, range and the standard error of range, in one pass."""

from typing import Any

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Map, Mask


def measure_rows(
    pair: RectifiedPair, limits_m: tuple[float, float], first: int, disparity: Map, sure: Map, std: Map, filled: Mask,
    depth_m: Map, range_m: Map, range_std_m: Map,
) -> None:  # fmt: skip
    """Fill depth_m, range_m and range_std_m for rows from ``first`` on of the left image.

    disparity, sure, std, filled: those rows; they too become unknown where the range lies outside the limits, and what was not
    measured has no confidence and no standard error. std: of disparity, pixels.
    """
    rays = pair.ray_length[first : first + disparity.shape[0]]
    shift_px, scale = np.float32(pair.cx_left_px - pair.cx_right_px), np.float32(pair.focal_px * pair.baseline_m)
    nearest, farthest = np.float32(limits_m[0]), np.float32(limits_m[1])
    _measure(disparity, sure, std, filled, rays, shift_px, scale, nearest, farthest, depth_m, range_m, range_std_m)


@compiled
def _measure(
    disparity: Map, sure: Map, std: Map, filled: Mask, rays: Map,
    shift_px: Any, scale: Any, nearest: Any, farthest: Any, depth_m: Map, range_m: Map, range_std_m: Map,
) -> None:  # fmt: skip
    none, unknown, per_px = np.float32(0), np.float32(np.nan), np.float32(1) / scale
    for y in range(disparity.shape[0]):
        d, c, s, f, ray = disparity[y], sure[y], std[y], filled[y], rays[y]
        depth_row, range_row, error_row = depth_m[y], range_m[y], range_std_m[y]
        for x in range(d.size):
            shifted = d[x] - shift_px
            depth = scale / shifted
            distance = depth * ray[x]
            known = (shifted > none) & (distance >= nearest) & (distance <= farthest)
            depth, distance = (depth, distance) if known else (unknown, unknown)
            measured = known & (not f[x])
            error = s[x] if measured else unknown
            d[x] = d[x] if known else unknown
            f[x] = f[x] & known
            c[x] = c[x] if measured else none
            s[x] = error
            depth_row[x] = depth
            range_row[x] = distance
            error_row[x] = distance * depth * error * per_px
