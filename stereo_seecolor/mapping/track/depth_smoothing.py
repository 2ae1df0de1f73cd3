"""Inverse depth smoothed by fitted planes: a plane, however it is tilted, is not changed."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.records import Map, SurveyFrame


@dataclass(frozen=True)
class SmoothingSettings:
    """When the depth around a pixel is used."""

    # inverse depths are averaged over it: as wide as their errors are correlated
    window_px: int = 9
    min_known: float = 0.6  # fraction of the window with a range
    max_spread_std: float = 3.0  # spread around a plane, in standard errors,
    # and as a fraction of the inverse depth: more is an edge, such as a fish's
    max_spread: float = 0.005
    unknown_std: float = 0.01  # standard error as a fraction of the range where it is not known


SETTINGS = SmoothingSettings()
LEAST_WINDOW = 3
"""Samples: a narrower window averages nothing, and holds no plane."""


@dataclass(frozen=True, eq=False)
class SmoothDepth:
    """Smoothed inverse depth at every so many pixels along both axes.

    inverse, std: (h, w) inverse depth and its standard error, 1/m. near: (h, w) inverse depth,
    averaged over the next samples alone. usable: (h, w), where it is measured and there is no edge.
    every: pixels from one sample to the next.
    """

    inverse: Map
    near: Map
    std: Map
    usable: NDArray[np.bool_]
    every: int

    def at(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """The inverse depth, the near one, their standard error and whether they are usable, (n,)
        each, at (n, 2) pixels of the frame.
        """
        places = (pixels - self.every // 2) / self.every
        columns, rows = np.clip(
            np.rint(places).astype(int), 0, np.array(self.usable.shape[::-1]) - 1
        ).T
        across, down = places.astype(np.float32).T
        inverse, near = (
            cv2.remap(depth, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            .ravel()
            .astype(np.float64)
            for depth in (self.inverse, self.near)
        )
        usable = self.usable[rows, columns] & np.isfinite(inverse + near)
        return inverse, near, self.std[rows, columns].astype(np.float64), usable


def smooth_depth(frame: SurveyFrame, geometry: RectifiedPair, every: int) -> SmoothDepth:
    """Fit a plane to the inverse depths of each window; inverse depths of a plane are linear in
    pixels, ranges are not.

    every: that many pixels along each axis are skipped but for one: neighbors have errors in common
    and tell little more.
    """
    some = (slice(every // 2, None, every),) * 2
    measured_m, stated_m = frame.range_m[some], frame.range_std_m[some]
    known = np.isfinite(measured_m) & (frame.confidence[some] > 0)
    range_m = np.where(known, measured_m, np.float32(1))
    inverse = np.where(known, geometry.ray_length[some] / range_m, 0).astype(np.float32)
    width = max(LEAST_WINDOW, SETTINGS.window_px // every // 2 * 2 + 1)  # of samples, odd
    share = _mean(known.astype(np.float32), width)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = _mean(inverse, width) / share
        near = _mean(inverse, LEAST_WINDOW) / _mean(known.astype(np.float32), LEAST_WINDOW)
        filled = np.where(known, inverse, mean)  # so that the windows' rims do not tilt the planes
        slope, mean_of = _slope(width)
        tilt = (
            cv2.sepFilter2D(filled, -1, slope, mean_of) ** 2
            + cv2.sepFilter2D(filled, -1, mean_of, slope) ** 2
        )
        variance = _mean(inverse * inverse, width) / share - mean**2 - tilt * (width**2 - 1) / 12
        std_m = np.where(np.isfinite(stated_m), stated_m, SETTINGS.unknown_std * range_m)
        std = std_m * inverse / range_m
        smooth = (
            np.sqrt(np.maximum(variance, 0))
            < SETTINGS.max_spread_std * std + SETTINGS.max_spread * mean
        )
    usable = known & (share > SETTINGS.min_known) & smooth
    return SmoothDepth(mean, near, std.astype(np.float32), usable, every)


def _mean(values: Map, width: int) -> Map:
    return np.asarray(cv2.blur(values, (width, width)), np.float32)


def _slope(width: int) -> tuple[Map, Map]:
    """Kernels along and across an axis whose product is the slope of a fitted plane."""
    offsets = np.arange(width, dtype=np.float32) - width // 2
    return offsets / np.float32((offsets**2).sum()), np.full(width, 1 / width, np.float32)
