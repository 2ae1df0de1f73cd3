"""The motion of the reef through the image in a dive. If it is small, the shading of a spot cannot
be distinguished from that of the lamps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.color.photometry.light_prior import Alike
from stereo_seecolor.color.photometry.observations import Observations


@dataclass(frozen=True)
class CrossingSettings:
    """In image sizes. Cross-validated on a real dive of 20 frames: patterns from parts of 2 to 10
    frames, applied to the other frames.
    """

    correlated: float = 10.0
    """Observations that count as one: neighbors share a caustic and errors of range and pose."""
    whole: float = 1.5
    """Motion below which more observations count as one, in inverse proportion. At 0.3 a pattern of
    luminance with 10 as one leaves 0.84 to 1.22 of the spread of other frames, 50 0.84 to 0.94.
    """
    color: float = 1.0
    """Least motion for a pattern of color: with less, other frames got worse (1.5 times at 0.3)."""


CROSSING_SETTINGS = CrossingSettings()


def pictures_crossed(windows: Sequence[Observations], size: tuple[int, int]) -> float:
    """Sum the motion of the reef from the first frame of each window to the nearest other one, in
    image sizes.

    size: (width, height) of the images of the observations.
    """
    return float(sum(_shift(window, size) for window in windows))


def alike(crossed: float, windows: int) -> Alike:
    """The numbers that count as one. crossed: of ``pictures_crossed``. windows: their number."""
    views = CROSSING_SETTINGS.correlated * max(
        1.0, CROSSING_SETTINGS.whole / max(crossed, 0.1 * CROSSING_SETTINGS.whole)
    )
    return Alike(views, max(windows / (1.0 + crossed), 1.0))


def _shift(seen: Observations, size: tuple[int, int]) -> float:
    """Median motion of a window's patches, in image sizes."""
    nearest = 1 + int(np.argmin(np.abs(seen.frames[1:] - seen.frames[0])))
    a, b = seen.of_both(0, nearest)
    if not a.size:
        return 0.0
    moved = (seen.pixel[a] - seen.pixel[b]) / np.array(size)
    return float(np.linalg.norm(np.median(moved, axis=0)))
