"""The point on the surface where a user clicked, with its covariance.

Errors of the ranges around a point are alike over a few pixels, and largest where the surface is
not flat, since matching blends what lies within its windows: at the rim of a coral a range is off
by several of its own standard errors, on flat ground by half of one. The plane that is fitted to
1 / depth shows it: what the ranges around depart from it (the misfit, a fraction of 1 / depth) adds
to the standard error of the point, and is that of its slope. Where the plane is steep, it is mostly
a ramp that these windows lay across a step, the more so the steeper it is: its place is off by some
pixels, and its range by these times the slope.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.extras.reef.measure_limits import LIMITS
from stereo_seecolor.records import Array, Map

STEP_PX = 8
"""Ranges of an edge before water or a far bottom end up to 5 pixels before it (a plate at 1.5 m
before a bottom at 3 m).
"""
STEP = 0.1
"""Relative step in depth that matters to a length across it; a slope has no step."""


@dataclass(frozen=True, eq=False)
class PickedPoint(ABC):
    """A point (3,) with its covariance (3, 3) by range and click, without calibration; meters, in
    any axes. gap_m: difference in depth or height beyond which two points lie on two things.
    """

    point_m: Array
    covariance: Array
    gap_m: float

    @abstractmethod
    def off_m(self, other: Self) -> float:
        """How far another point lies off the plane of the surface here, along depth or height."""


@dataclass(frozen=True, eq=False)
class Pick(PickedPoint):
    """A point of the surface, in the rectified left camera's axes.

    x_px, y_px: where it was clicked. range_std_m: standard error of its range. pixel_std_m: that of
    a range of one pixel, as matching states it. slope: (2,) change of 1 / depth a pixel, 1/m.
    slope_std: standard error of each of these.
    """

    x_px: float
    y_px: float
    range_std_m: float
    pixel_std_m: float
    slope: Array
    slope_std: float

    @property
    def range_m(self) -> float:
        """Distance along the ray."""
        return float(np.linalg.norm(self.point_m))

    def off_m(self, other: Self) -> float:
        """How far another point lies off the plane of the surface here, in depth."""
        way = np.array([other.x_px - self.x_px, other.y_px - self.y_px])
        depth_m = float(other.point_m[2])
        return float(abs(1 / depth_m - 1 / self.point_m[2] - self.slope @ way) * depth_m**2)


@dataclass(frozen=True, eq=False)
class FrameSurface:
    """The surface that a frame shows. range_m: (H, W), measured pixels only. std_blocks_m: standard
    errors of blocks of 4x4 pixels.
    """

    geometry: RectifiedPair
    range_m: Map
    std_blocks_m: Map
    block_px: int = 4

    def pick(self, x_px: float, y_px: float, click_px: float = LIMITS.click_std_px) -> Pick | None:
        """The surface at a place of the image that was hit to within ``click_px``; None where
        nothing was measured around it.

        A plane is fitted to 1 / depth in a window of 7x7 pixels, where 1 / depth of a plane is
        linear. Where the window shows two layers, as at the edge of a coral, the nearer one is
        taken if enough of it is there.
        """
        window = self._window(x_px, y_px)
        if window is None:
            return None
        g, (dx, dy, inverse, relative_std) = self.geometry, window
        layer = nearest_layer(inverse, relative_std)
        value, slope, leverage = _plane(dx[layer], dy[layer], inverse[layer])
        if value <= 0:
            return None
        misfit = self._misfit(x_px, y_px, value, slope)
        steep = float(slope @ slope) / value**2 * g.focal_px
        parts = LIMITS.of_range * relative_std, LIMITS.of_misfit * misfit, LIMITS.of_ramp_px * steep
        std = float(np.linalg.norm(parts)) * leverage
        ray = np.array([(x_px - g.cx_left_px) / g.focal_px, (y_px - g.cy_px) / g.focal_px, 1.0])
        point_m, depth_m = ray / value, 1 / value
        by_click = depth_m / g.focal_px * np.eye(2, 3) - depth_m**2 * slope[:, None] * ray
        covariance = np.outer(std * point_m, std * point_m) + click_px**2 * by_click.T @ by_click
        range_m = float(np.linalg.norm(point_m))
        slope_std = LIMITS.slope_of_misfit * misfit * value
        gap_m = max(LIMITS.layer_gap, LIMITS.layer_gap_stds * relative_std) * depth_m
        stds_m = std * range_m, relative_std * range_m
        return Pick(point_m, covariance, gap_m, x_px, y_px, *stds_m, slope, slope_std)

    def _misfit(self, x_px: float, y_px: float, value: float, slope: Array) -> float:
        """Root mean square of what 1 / depth within STEP_PX departs from a plane, as a fraction.

        Another layer, far behind, counts no more than as the beginning of a step.
        """
        window = self._window(x_px, y_px, STEP_PX)
        if window is None:
            return 0.0
        dx, dy, inverse, relative_std = window
        off = np.abs(inverse - value - slope[0] * dx - slope[1] * dy) / value
        most = 2 * max(LIMITS.layer_gap, LIMITS.layer_gap_stds * relative_std)
        return float(np.sqrt(np.mean(np.minimum(off, most) ** 2)))

    def nearer_m(self, pick: Pick) -> float | None:
        """Depth of a nearer surface that lies within STEP_PX of a point, as beside a fish or a
        coral; None where there is none.

        Ranges end some pixels before the edge of what is near, so a click on the edge finds what
        lies behind it.
        """
        window = self._window(pick.x_px, pick.y_px, STEP_PX)
        if window is None:
            return None
        dx, dy, inverse, relative_std = window
        expected = 1 / pick.point_m[2] + pick.slope[0] * dx + pick.slope[1] * dy
        nearer = inverse - expected > max(STEP, LIMITS.layer_gap_stds * relative_std) * expected
        return (
            float(1 / np.median(inverse[nearer])) if nearer.sum() >= LIMITS.least_pixels else None
        )

    def _window(
        self, x_px: float, y_px: float, half: int = LIMITS.half_window_px
    ) -> tuple[Array, Array, Array, float] | None:
        """Offsets from the click, 1 / depth, and the relative standard error of a range, of the
        known pixels around a click.
        """
        height, width = self.range_m.shape
        column, row = int(np.floor(x_px + 0.5)), int(np.floor(y_px + 0.5))
        if not (0 <= column < width and 0 <= row < height):
            return None
        y, x = np.mgrid[
            max(row - half, 0) : min(row + half + 1, height),
            max(column - half, 0) : min(column + half + 1, width),
        ]
        range_m = self.range_m[y, x].astype(np.float64)
        known = np.isfinite(range_m)
        if known.sum() < LIMITS.least_pixels:
            return None
        x, y, range_m = x[known], y[known], range_m[known]
        std_m = self.std_blocks_m[y // self.block_px, x // self.block_px].astype(np.float64)
        relative = std_m / range_m
        known_std = relative[np.isfinite(relative)]
        g = self.geometry
        ray = np.sqrt(
            1 + ((x - g.cx_left_px) / g.focal_px) ** 2 + ((y - g.cy_px) / g.focal_px) ** 2
        )
        return (
            x - x_px,
            y - y_px,
            ray / range_m,
            float(np.sort(known_std)[known_std.size // 2]) if known_std.size else 0.0,
        )


def nearest_layer(inverse: Array, relative_std: float) -> NDArray[np.bool_]:
    """Select the values of 1 / depth (N,) of the nearest layer that holds enough of them; the
    largest layer where none does: (N,) bool.
    """
    order = np.argsort(-inverse, kind="stable")
    ranked = inverse[order]
    gap = max(LIMITS.layer_gap, LIMITS.layer_gap_stds * relative_std)
    cuts = [0, *(np.flatnonzero(ranked[:-1] - ranked[1:] > gap * ranked[:-1]) + 1), ranked.size]
    layers = [order[a:b] for a, b in pairwise(cuts)]
    chosen = next(
        (layer for layer in layers if layer.size >= LIMITS.least_pixels), max(layers, key=len)
    )
    member = np.zeros(inverse.size, bool)
    member[chosen] = True
    return member


def _plane(dx: Array, dy: Array, inverse: Array) -> tuple[float, Array, float]:
    """Value at the click and slope of the plane through values at offsets; the mean, flat, where
    they do not span one.

    Also how many times as large the standard error of the value is as with a full window: more
    where only one side of the click is known.
    """
    full = (2 * LIMITS.half_window_px + 1) ** 2
    A = np.stack([np.ones_like(dx), dx, dy], axis=1)
    normal = A.T @ A
    if dx.size < LIMITS.least_pixels or np.linalg.det(normal) < 1e-6 * dx.size**3:
        return float(inverse.mean()), np.zeros(2), float(np.sqrt(full / dx.size))
    solved = np.linalg.solve(normal, np.column_stack([A.T @ inverse, (1.0, 0.0, 0.0)]))
    return float(solved[0, 0]), solved[1:, 0], float(np.sqrt(max(full * solved[0, 1], 1.0)))
