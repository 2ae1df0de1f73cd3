"""How far the reef moves through the image in a dive. If it moves little, a spot's own shading cannot be told from the lamps'."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereo_seecolor.color.photometry.sightings import SeenWindow


@dataclass(frozen=True)
class CrossingSettings:
    """Limits on the reef's motion through the picture, in sizes of the picture. Chosen by cross-validation on a real dive of
    20 frames: the pattern of each part of 2 to 10 frames was applied to the frames outside it.
    """

    alike: float = 10.0
    """Number of sightings that count as one: neighbors are under the same caustic, and have the same errors of range and pose."""
    whole: float = 1.5
    """Motion below which more sightings count as one, in inverse proportion. Three neighboring frames cross 0.3: their pattern of
    luminance left 0.84 to 1.22 of the spread of other frames with 10 alike, with 50 it leaves 0.84 to 0.94."""
    color: float = 1.0
    """Least for a pattern of color. With less, it made other frames worse (up to 1.5 times at 0.3, 1.3 at 0.7)."""


SETTINGS = CrossingSettings()


def pictures_crossed(windows: Sequence[SeenWindow], size: tuple[int, int]) -> float:
    """The sum over all windows of the reef's motion through the image, from the window's first frame to the nearest other.

    In image sizes. size: (width, height) of the images that the sightings' pixels are of.
    """
    return float(sum(_shift(window, size) for window in windows))


def alike(crossed: float) -> float:
    """The number of correlated sightings that count as one. crossed: of ``pictures_crossed``."""
    return SETTINGS.alike * max(1.0, SETTINGS.whole / max(crossed, 0.1 * SETTINGS.whole))


def _shift(window: SeenWindow, size: tuple[int, int]) -> float:
    """Median motion of a window's patches, in image sizes."""
    nearest, seen = 1 + int(np.argmin(np.abs(window.frames[1:] - window.frames[0]))), window.seen
    first, there = (np.flatnonzero(seen.frame == number) for number in (0, nearest))
    common, a, b = np.intersect1d(seen.patch[first], seen.patch[there], assume_unique=True, return_indices=True)
    if not common.size:
        return 0.0
    moved = (seen.pixel[first[a]] - seen.pixel[there[b]]) / np.array(size)
    return float(np.linalg.norm(np.median(moved, axis=0)))
