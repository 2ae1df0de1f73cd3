"""Limits and thresholds of measurements on a frame; web/src/measure.ts has the same numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasureLimits:
    """Windows, layers and errors."""

    half_window_px: int = 3  # 7x7: more is no more exact where a reef is rough, less is noisy
    least_pixels: int = 10  # a fifth of the window: an object's edge shows at least that
    layer_gap: float = (
        0.02  # relative step in depth between object and background; slopes are steadier
    )
    layer_gap_stds: float = 6.0  # no step is smaller than the noise
    click_std_px: float = 0.5  # how well a person hits a point
    # of a length, relative, where nothing else is known: what docs/calibration.md calls good
    calibration_std: float = 0.005
    least_step_px: int = 8  # along a line: windows that overlap little
    step_stds: float = (
        6.0  # a step along the surface is longer than its noise, which would lengthen it
    )
    area_step_px: int = 4  # a node of the area every fourth pixel


LIMITS = MeasureLimits()
