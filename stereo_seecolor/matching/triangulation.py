"""Triangulation: depth, range and the standard error of range from disparity, in one pass."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.records import Map, Mask, RangeMap


@dataclass(frozen=True, eq=False)
class RangeMaps:
    """The maps of a pair while they are filled, strip by strip, as in RangeMap.

    Until ``measure`` has converted it to meters, range_std_m holds the standard error of the
    disparity, pixels.
    """

    disparity: Map
    confidence: Map
    depth_m: Map
    range_m: Map
    range_std_m: Map
    filled: Mask

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> "RangeMaps":
        """Allocate maps of this shape; only ``filled`` has defined content, False."""
        # One block: the allocator then keeps its memory from pair to pair, and the system need not
        # clear it again.
        disparity, confidence, depth_m, range_m, range_std_m = np.empty((5, *shape), np.float32)
        return cls(disparity, confidence, depth_m, range_m, range_std_m, np.zeros(shape, np.bool_))

    def measure(self, pair: RectifiedPair, limits_m: tuple[float, float], rows: slice) -> None:
        """Compute depth, range and the standard error of range in these rows.

        Ranges outside the limits become unknown, without confidence and standard error.
        """
        shift_px = np.float32(pair.cx_left_px - pair.cx_right_px)
        scale = np.float32(pair.focal_px * pair.baseline_m)
        changed = (
            self.disparity[rows],
            self.confidence[rows],
            self.filled[rows],
            self.range_std_m[rows],
        )
        found = self.depth_m[rows], self.range_m[rows]
        limits = np.float32(limits_m[0]), np.float32(limits_m[1])
        _measure(pair.ray_length[rows], changed, found, (shift_px, scale), limits)

    def range_map(self) -> RangeMap:
        """The finished range map."""
        return RangeMap(**vars(self))


@compiled
def _measure(rays: Any, changed: Any, found: Any, geometry: Any, limits_m: Any) -> None:
    disparity, confidence, filled, std = changed
    depth_m, range_m = found
    shift_px, scale = geometry
    nearest, farthest = limits_m
    none, unknown, per_px = np.float32(0), np.float32(np.nan), np.float32(1) / scale
    for y in range(disparity.shape[0]):
        d, c, s, f, ray = disparity[y], confidence[y], std[y], filled[y], rays[y]
        depth_row, range_row = depth_m[y], range_m[y]
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
            s[x] = distance * depth * error * per_px
            depth_row[x] = depth
            range_row[x] = distance
