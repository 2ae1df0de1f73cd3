"""The inverse depth around each pixel, smoothed; a plane, however it is tilted, stays the plane it is."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.records import SurveyFrame

Map = NDArray[np.float32]


@dataclass(frozen=True)
class SmoothingSettings:
    """When the depth around a pixel is used."""

    window_px: int = 9  # inverse depths are averaged over it: as wide as their errors are correlated
    min_known: float = 0.6  # fraction of the window with a range
    max_spread_std: float = 3.0  # spread around a plane, in standard errors,
    max_spread: float = 0.005  # and as a fraction of the inverse depth: more is an edge, such as a fish's
    unknown_std: float = 0.01  # standard error as a fraction of the range where it is not known


SETTINGS = SmoothingSettings()


@dataclass(frozen=True, eq=False)
class SmoothDepth:
    """inverse, std: (H, W) inverse depth and its standard error, 1/m. usable: (H, W), where it is measured and there is no edge."""

    inverse: Map
    std: Map
    usable: NDArray[np.bool_]


def smooth_depth(frame: SurveyFrame, geometry: RectifiedPair) -> SmoothDepth:
    """A plane fitted to the inverse depths of each window, which are linear in the pixels of a plane; ranges are not."""
    known = np.isfinite(frame.range_m) & (frame.confidence > 0)
    range_m = np.where(known, frame.range_m, np.float32(1))
    inverse = np.where(known, geometry.ray_length / range_m, 0).astype(np.float32)
    share = _mean(known.astype(np.float32))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = _mean(inverse) / share
        filled = np.where(known, inverse, mean)  # so that the windows' rims do not tilt the planes
        slope, mean_of = _slope()
        tilt = cv2.sepFilter2D(filled, -1, slope, mean_of) ** 2 + cv2.sepFilter2D(filled, -1, mean_of, slope) ** 2
        variance = _mean(inverse * inverse) / share - mean**2 - tilt * (SETTINGS.window_px**2 - 1) / 12
        std_m = np.where(np.isfinite(frame.range_std_m), frame.range_std_m, SETTINGS.unknown_std * range_m)
        std = std_m * inverse / range_m
        smooth = np.sqrt(np.maximum(variance, 0)) < SETTINGS.max_spread_std * std + SETTINGS.max_spread * mean
    usable = known & (share > SETTINGS.min_known) & smooth
    return SmoothDepth(mean.astype(np.float32), std.astype(np.float32), usable)


def _mean(values: Map) -> Map:
    return np.asarray(cv2.blur(values, (SETTINGS.window_px, SETTINGS.window_px)), np.float32)


def _slope() -> tuple[Map, Map]:
    """Kernels along and across an axis whose product is the slope of the plane of least squares along it."""
    width = SETTINGS.window_px
    offsets = np.arange(width, dtype=np.float32) - width // 2
    return offsets / np.float32((offsets**2).sum()), np.full(width, 1 / width, np.float32)
