"""Corners of a marker to a fiftieth of a pixel, as intersections of lines fitted to its four sides.

A corner that is looked for at the corner itself lies inside by a tenth of a pixel, since blur
rounds corners; it does not move the middle of a side. Blur acts on light: in values encoded as sRGB
a white margin grows over the black by a fourth to half a pixel.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.records import Array


@dataclass(frozen=True)
class EdgeSettings:
    """Where the sides are searched."""

    samples: int = 32  # along a side
    kept: tuple[float, float] = (0.1, 0.9)  # of it: nearer to the corners blur rounds it
    reach_px: float = 3.0  # to both sides, and
    # at most this fraction of it: the first squares of the code are an eighth away
    reach_side: float = 0.07
    step_px: float = 0.25
    rounds: int = 2  # the first begins where the search around a side is off its middle


SETTINGS = EdgeSettings()


def refined(light: NDArray[np.float32], corners_px: Array) -> Array:
    """Refine rough corners (4, 2) of a dark square in linear light (H, W), if all sides show."""
    for _ in range(SETTINGS.rounds):
        sides = [_side(light, corners_px[i], corners_px[(i + 1) % 4]) for i in range(4)]
        if any(side is None for side in sides):
            break
        met = intersections(np.array(sides))
        corners_px = np.asarray(met[:, :2] / met[:, 2:])
    return corners_px


def intersections(lines: Array) -> Array:
    """Homogeneous (n, 3) points where each of the lines (n, 3) meets the one before it."""
    return np.cross(np.roll(lines, 1, axis=0), lines)


def line_through(points: NDArray[np.float32]) -> Array:
    """(3,) the line a x + b y + c = 0 near most of the points (n, 2)."""
    vx, vy, x, y = np.ravel(cv2.fitLine(points, cv2.DIST_HUBER, 0, 0.001, 0.001)).astype(np.float64)
    return np.array([-vy, vx, vy * x - vx * y])


def _side(light: NDArray[np.float32], start: Array, end: Array) -> Array | None:
    """(3,) the line a x + b y + c = 0 along a side, through each profile's steepest place."""
    along = end - start
    length = float(np.linalg.norm(along))
    across = np.array([-along[1], along[0]]) / length
    reach = min(SETTINGS.reach_px, SETTINGS.reach_side * length)
    offsets = np.arange(-reach, reach + SETTINGS.step_px / 2, SETTINGS.step_px)
    if len(offsets) < 5:
        return None
    feet = start + np.linspace(*SETTINGS.kept, SETTINGS.samples)[:, None] * along
    places = (feet[:, None] + offsets[:, None] * across).astype(np.float32)
    profiles = cv2.remap(light, places[..., 0], places[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    steepness = np.abs(np.diff(profiles, axis=1)) ** 2
    total = steepness.sum(axis=1)
    if not (total > 0).all():
        return None
    at = (steepness * (offsets[1:] + offsets[:-1]) / 2).sum(axis=1) / total
    return line_through((feet + at[:, None] * across).astype(np.float32))
