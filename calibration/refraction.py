"""Cameras behind a flat port: exact Snell rays through air, glass and water, and the pinhole in
water that stands for them.

A flat port has no single center of projection: water rays meet the port's axis the farther behind
it, the wider their angle (Treibitz et al. 2012, Flat refractive geometry). Here a camera becomes
the pinhole whose center is the middle of these crossings, with a table of pixels that is exact for
points at one working range; ``checks.port_range_errors`` tells what is left at others.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.geometry import Array
from calibration.port import FlatPort, FlatWindow
from calibration.rig import Camera, StereoRig

NEWTON_STEPS = 30  # a bound: convergence is quadratic
TOLERANCE_M = 1e-9  # of a point on the glass: 1e-6 px


@dataclass(frozen=True, eq=False)
class CameraInWater:
    """A camera behind a flat window, seen from the water: rays start at ``center_m``."""

    camera: Camera
    window: FlatWindow
    port: FlatPort

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the image, pixels."""
        return self.camera.image_size

    @cached_property
    def center_m(self) -> Array:
        """The center of the pinhole in camera axes, (3,): the median, over the image, of where
        water rays meet the port's normal.
        """
        width, height = self.image_size
        x, y = np.meshgrid(np.linspace(0, width - 1, 21), np.linspace(0, height - 1, 21))
        points, directions = self.trace(np.column_stack([x.ravel(), y.ravel()]))
        N = self.window.normal
        along, out = points @ N, directions @ N
        aside = np.linalg.norm(points - along[:, None] * N, axis=1)
        slope = np.sqrt(np.maximum(1 - out**2, 0)) / out
        with np.errstate(invalid="ignore", divide="ignore"):
            crossings = along - aside / slope
        crossings = crossings[np.isfinite(crossings) & (slope > 0.02)]
        middle = np.median(crossings) if crossings.size else self._paraxial_crossing_m
        return np.asarray(middle * N)

    def trace(self, pixels: Array) -> tuple[Array, Array]:
        """Trace the rays of pixels (n, 2): where they leave the window (n, 3), and their unit
        directions in water (n, 3), camera axes.
        """
        N, window, port = self.window.normal, self.window, self.port
        in_air = self.camera.rays(pixels)
        in_air /= np.linalg.norm(in_air, axis=1, keepdims=True)
        in_glass = _bend(in_air, N, 1 / port.glass_index)
        in_water = _bend(in_glass, N, port.glass_index / port.water_index)
        points = (
            in_air * (window.distance_m / (in_air @ N))[:, None]
            + in_glass * (window.thickness_m / (in_glass @ N))[:, None]
        )
        return points, in_water

    def project_points(self, points_m: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) in the water, camera axes, exact; NaN where no ray leads.

        n sin(theta) is one number along a ray; the angle in air solves d tan(a) + t tan(g) + h
        tan(w) = rho. The left side is concave in tan(a), so that Newton's steps from the straight
        line never overshoot.
        """
        N, window = self.window.normal, self.window
        along = points_m @ N
        aside = points_m - along[:, None] * N
        rho = np.linalg.norm(aside, axis=1)
        in_water_m = along - window.distance_m - window.thickness_m
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            slope = np.where(in_water_m > 0, rho / along, np.nan)
            for _ in range(NEWTON_STEPS):
                reached, gain = self._reach(slope, in_water_m)
                step = (rho - reached) / gain
                slope = slope + step
                if not (np.abs(step) > TOLERANCE_M).any():
                    break
            slope[~(np.abs(self._reach(slope, in_water_m)[0] - rho) < 1e-7)] = np.nan
            outward = aside / np.maximum(rho, 1e-15)[:, None]
        return self.camera.project(N + slope[:, None] * outward)

    def rays(self, pixels: Array) -> Array:
        """Compute directions with z = 1, (n, 3), from ``center_m`` to where each pixel's ray meets
        the working range.
        """
        points, directions = self.trace(pixels)
        length = (self._working_z_m - points[:, 2]) / directions[:, 2]
        seen = points + directions * length[:, None] - self.center_m
        return np.asarray(seen / seen[:, 2:])

    def project(self, directions: Array) -> Array:
        """Pixels (n, 2) of directions (n, 3) from ``center_m``, for points at the working range."""
        depth = self.port.working_range_m
        return self.project_points(directions / directions[:, 2:] * depth + self.center_m)

    @property
    def _working_z_m(self) -> float:
        return float(self.port.working_range_m + self.center_m[2])

    @property
    def _paraxial_crossing_m(self) -> float:
        window, port = self.window, self.port
        behind = port.water_index * (window.distance_m + window.thickness_m / port.glass_index)
        return window.distance_m + window.thickness_m - behind

    def _reach(self, slope: Array, in_water_m: Array) -> tuple[Array, Array]:
        """How far aside a ray of this slope in air comes, and how that grows with the slope."""
        window, port = self.window, self.port
        q2 = slope**2 / (1 + slope**2)
        dq_dslope = (1 + slope**2) ** -1.5
        reached, gain = window.distance_m * slope, np.full_like(slope, window.distance_m)
        for length, index in (
            (window.thickness_m, port.glass_index),
            (in_water_m, port.water_index),
        ):
            cosine2 = index**2 - q2
            reached = reached + length * np.sqrt(q2 / cosine2)
            gain = gain + length * index**2 * cosine2**-1.5 * dq_dslope
        return reached, gain


def cameras_in_water(
    rig: StereoRig,
) -> tuple[Camera | CameraInWater, Camera | CameraInWater, Array]:
    """Convert a rig to water: two cameras, and the (4, 4) transform from left to right."""
    if not isinstance(rig.port, FlatPort):
        return rig.left, rig.right, rig.T_right_left
    left = CameraInWater(rig.left, rig.port.left, rig.port)
    right = CameraInWater(rig.right, rig.port.right, rig.port)
    T = rig.T_right_left.copy()
    T[:3, 3] += rig.R @ left.center_m - right.center_m
    return left, right, T


def _bend(directions: Array, normal: Array, ratio: float) -> Array:
    """Snell's law for unit directions (n, 3) through a plane; ratio: index before over behind."""
    cosine = directions @ normal
    behind = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    return np.asarray(ratio * directions + (behind - ratio * cosine)[:, None] * normal)
