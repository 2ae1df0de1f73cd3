"""Limits and thresholds of measurements on a frame; web/src/measure.ts has the same numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasureLimits:
    """Windows, layers and errors."""

    half_window_px: int = 3  # 7x7: more is no more exact where a reef is rough, less is noisy
    least_pixels: int = 10  # a fifth of the window: an object's edge shows at least that
    # relative step in depth between object and background; slopes are steadier
    layer_gap: float = 0.02
    layer_gap_stds: float = 6.0  # no step is smaller than the noise
    # what the error of a pixel's range, the misfit of the plane around and its slope (at 45 degrees
    # to the ray) add to the standard error of a point, and what the misfit adds to that of a slope,
    # a pixel (picking.py): as benchmarks/standard_errors.py finds them on synthetic reefs
    of_range: float = 0.45
    of_misfit: float = 0.3
    of_ramp_px: float = 0.35
    slope_of_misfit: float = 0.131
    # the part of an area by errors of slopes, which is taken off it, is known to this
    of_slopes: float = 0.15
    of_step: float = 0.16  # of the steps along a line, in its standard error
    # errors across a line, or along an area's normal, count squared over twice its size: where they
    # are k standard errors, they change it by k^2 / 2 variances. Of normal errors 97.5 % change it
    # by less than two of this many variances, and 99.96 % by less than five
    of_squares: float = 5 / 4
    click_std_px: float = 0.5  # how well a person hits a point
    least_step_px: int = 8  # along a line: windows that overlap little
    # a step along the surface is longer than its noise, which would lengthen it
    step_stds: float = 6.0
    area_step_px: int = 4  # a node of the area every fourth pixel


LIMITS = MeasureLimits()
