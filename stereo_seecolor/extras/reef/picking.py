"""The point on the surface where a user clicked, with its covariance."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.records import Map
from stereo_seecolor.report.calibration_std import LIMITS

Array = NDArray[np.float64]
STEP_PX = 8
"""Ranges of an edge before water or a far bottom end up to 5 pixels before it (a plate at 1.5 m
before a bottom at 3 m).
"""
STEP = 0.1
"""Relative step in depth that matters to a length across it; a slope has no step."""


@dataclass(frozen=True, eq=False)
class PickedPoint:
    """A point (3,) with its covariance (3, 3) by range and click, without calibration; meters, in
    any axes.
    """

    point_m: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Pick(PickedPoint):
    """A point of the surface, in the rectified left camera's axes.

    x_px, y_px: where it was clicked. range_std_m: standard error of its range. slope: (2,) change
    of 1 / depth a pixel, 1/m.
    """

    x_px: float
    y_px: float
    range_std_m: float
    slope: Array

    @property
    def range_m(self) -> float:
        """Distance along the ray."""
        return float(np.linalg.norm(self.point_m))


@dataclass(frozen=True, eq=False)
class FrameSurface:
    """The surface that a frame shows. range_m: (H, W), measured pixels only. std_blocks_m: standard
    errors of blocks of 4x4 pixels.
    """

    geometry: RectifiedPair
    range_m: Map
    std_blocks_m: Map
    block_px: int = 4

    def pick(self, x_px: float, y_px: float) -> Pick | None:
        """The surface at a place of the image; None where nothing was measured around it.

        A plane is fitted to 1 / depth in a window of 7x7 pixels, where 1 / depth of a plane is
        linear. Where the window shows two layers, as at the edge of a coral, the nearer one is
        taken if enough of it is there.
        """
        window = self._window(x_px, y_px)
        if window is None:
            return None
        dx, dy, inverse, relative_std = window
        layer = nearest_layer(inverse, relative_std)
        value, slope = _plane(dx[layer], dy[layer], inverse[layer])
        return self._point(x_px, y_px, value, slope, relative_std) if value > 0 else None

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

    def _point(
        self, x_px: float, y_px: float, inverse: float, slope: Array, relative_std: float
    ) -> Pick:
        g = self.geometry
        depth_m = 1 / inverse
        ray = np.array([(x_px - g.cx_left_px) / g.focal_px, (y_px - g.cy_px) / g.focal_px, 1.0])
        point_m = depth_m * ray
        by_click = np.stack(
            [np.array([depth_m / g.focal_px, 0, 0]), np.array([0, depth_m / g.focal_px, 0])]
        )
        by_click -= depth_m**2 * slope[:, None] * ray
        along = relative_std * point_m
        covariance = np.outer(along, along) + LIMITS.click_std_px**2 * by_click.T @ by_click
        return Pick(
            point_m, covariance, x_px, y_px, relative_std * float(np.linalg.norm(point_m)), slope
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


def _plane(dx: Array, dy: Array, inverse: Array) -> tuple[float, Array]:
    """Value at the click and slope of the plane through values at offsets; the mean, flat, where
    they do not span one.
    """
    A = np.stack([np.ones_like(dx), dx, dy], axis=1)
    normal = A.T @ A
    if dx.size < LIMITS.least_pixels or np.linalg.det(normal) < 1e-6 * dx.size**3:
        return float(inverse.mean()), np.zeros(2)
    solved = np.linalg.solve(normal, A.T @ inverse)
    return float(solved[0]), solved[1:]
