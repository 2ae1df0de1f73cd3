"""Disparities: how engines return them, gaps filled, and depth and range from them."""

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.matching.gray import LARGE_IMAGE_PX, GrayPair
from stereo_seecolor.records import Map, Mask, RangeMap, StereoFrame

# The interface of the matching engines, and the disparities that they return.

UNKNOWN = np.float32(np.nan)


@dataclass(frozen=True, eq=False)
class MatchedDisparity:
    """Disparities of the left image of a pair.

    disparity: (H, W) float32 pixels, x_left - x_right, NaN where nothing was found that passes the
    engine's checks.

    best: (H, W) the same, but also where the checks failed; NaN where nothing was found at all. The
    same array for an engine that gives only what it checked.
    uniqueness: (H, W) how much worse the best disparity beyond +-1 px is, as a fraction of P2;
    large where no other fits.
    reduced_fraction: of the pixels at reduced size, those that passed the checks; 0 for an engine
    that does not look there.
    """

    disparity: Map
    best: Map
    uniqueness: Map
    reduced_fraction: float = 0.0

    def forget(self, where: Mask) -> None:
        """Make unknown, checked or not, where ``where`` (H, W) is True."""
        for disparity in (self.disparity, self.best):
            np.copyto(disparity, UNKNOWN, where=where)


class Engine(Protocol):
    """An engine that finds disparities. refined: True if they need no sub-pixel refinement."""

    refined: bool

    def find(self, frame: StereoFrame, pair: GrayPair) -> MatchedDisparity:
        """Find the disparities of a rectified pair; safe to call from many threads."""


FIXED_UNIQUENESS = 0.5
"""Uniqueness for engines that give none: the median of well matched pixels of the synthetic
reef.
"""


# Interpolation of disparities where none was found.

REACH = 0.1
"""How far from a measured pixel of its row, as a fraction of the width, a pixel may be
interpolated.
"""


def fill(disparity: Map) -> Map:
    """Close the holes of a disparity map (H, W); measured pixels stay as they are, and pixels too
    far from any measured one stay NaN.

    What one camera does not see lies behind, so a hole takes the smaller disparity of its two ends
    in the row (Hirschmueller 2008, section 2.5), then the median of 5 x 5, which joins the rows.
    Smoothing across the hole instead (WLS) was worse.
    """
    ends = np.empty_like(disparity)
    _ends(disparity, REACH * disparity.shape[1], ends)
    joined: Map = cv2.medianBlur(np.nan_to_num(ends), 5)
    _keep(disparity, ends, joined)
    return joined


@compiled
def _ends(disparity: Map, reach: float, ends: Map) -> None:
    """Each pixel of a hole the smaller of the known disparities at its ends in the row, NaN where
    both are beyond the reach.
    """
    height, width = disparity.shape
    for y in range(height):
        last = -width
        for x in range(width):
            if np.isfinite(disparity[y, x]):
                last = x
            ends[y, x] = disparity[y, last] if x - last <= reach else np.nan
        last = 2 * width
        for x in range(width - 1, -1, -1):
            if np.isfinite(disparity[y, x]):
                last = x
            if last - x <= reach and not ends[y, x] <= disparity[y, last]:
                ends[y, x] = disparity[y, last]


@compiled
def _keep(disparity: Map, ends: Map, joined: Map) -> None:
    """Put back what was measured, and NaN where nothing can be interpolated."""
    for y in range(joined.shape[0]):
        for x in range(joined.shape[1]):
            interpolated = joined[y, x] if np.isfinite(ends[y, x]) else np.float32(np.nan)
            joined[y, x] = disparity[y, x] if np.isfinite(disparity[y, x]) else interpolated


# Triangulation: depth, range and the standard error of range from disparity, in one pass.


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

        What lies outside the limits of range becomes unknown; what was not measured has no
        confidence and no standard error.
        """
        shift_px, scale = (
            np.float32(pair.cx_left_px - pair.cx_right_px),
            np.float32(pair.focal_px * pair.baseline_m),
        )
        changed = (
            self.disparity[rows],
            self.confidence[rows],
            self.filled[rows],
            self.range_std_m[rows],
        )
        found, limits = (
            (self.depth_m[rows], self.range_m[rows]),
            (np.float32(limits_m[0]), np.float32(limits_m[1])),
        )
        _measure(pair.ray_length[rows], changed, found, (shift_px, scale), limits)

    def range_map(self) -> RangeMap:
        """The finished range map."""
        return RangeMap(
            self.disparity,
            self.depth_m,
            self.range_m,
            self.range_std_m,
            self.confidence,
            self.filled,
        )


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


# Removal of small patches of disparity, which are mismatches.

_UNKNOWN = -0x8000
PER_PX = 16
"""OpenCV's fixed-point disparities; neighbors that differ by a pixel or less belong to one
patch.
"""


def remove_speckles(disparity: Map, pixels: int) -> None:
    """Set disparities to NaN, in place, where fewer than ``pixels`` connected pixels share a
    disparity to within one pixel.
    """
    every = 2 if disparity.size > LARGE_IMAGE_PX else 1
    thin = disparity[::every, ::every]
    fixed = np.where(np.isfinite(thin), thin * np.float32(PER_PX), _UNKNOWN).astype(np.int16)
    kept = fixed.copy()
    cv2.filterSpeckles(kept, _UNKNOWN, pixels // every**2, PER_PX)
    speckle = kept != fixed
    for row in range(every):
        for column in range(every):
            part = disparity[row::every, column::every]
            part[speckle[: part.shape[0], : part.shape[1]]] = np.nan
