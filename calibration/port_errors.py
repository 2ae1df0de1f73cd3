"""Range errors of a flat port, modeled or ignored: exact rays against the rectification."""

from dataclasses import dataclass

import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry import Array
from calibration.rectification import plan_rectification, rectified_points
from calibration.refraction import CameraInWater, cameras_in_water
from calibration.rig import StereoRig

GRID = (17, 13)  # points over the image, columns and rows: errors of a port are smooth


@dataclass(frozen=True, eq=False)
class PortError:
    """Errors over the image at each depth_m (k,) before the rig; NaN without a shared view.

    range_error: root mean square, relative; row_error_px: root mean square difference of rows.
    """

    depth_m: Array
    range_error: Array
    row_error_px: Array


def port_error(rig: StereoRig, depth_m: Array, seen_as: StereoRig | None = None) -> PortError:
    """Trace points before ``rig``, which must have a flat port, and measure them as ``seen_as``
    does, by default the same rig.

    Raises CalibrationError for a rig without a flat port.
    """
    seen_as = seen_as or rig
    traced = [_errors_at(rig, seen_as, float(depth)) for depth in depth_m]
    ranges, rows = np.array(traced).T
    return PortError(depth_m, ranges, rows)


def _errors_at(rig: StereoRig, seen_as: StereoRig, depth_m: float) -> tuple[float, float]:
    points, pixels = _traced(rig, depth_m)
    if len(points) == 0:
        return np.nan, np.nan
    left, right = rectified_points(seen_as, *pixels)
    pair = plan_rectification(seen_as).matching_pair
    disparity = left[:, 0] - right[:, 0] - (pair.cx_left_px - pair.cx_right_px)
    slopes = (left - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
    range_m = pair.focal_px * pair.baseline_m / disparity * np.sqrt(1 + (slopes**2).sum(axis=1))
    relative = range_m / np.linalg.norm(points, axis=1) - 1
    return float(np.sqrt(np.mean(relative**2))), float(
        np.sqrt(np.mean((left[:, 1] - right[:, 1]) ** 2))
    )


def _traced(rig: StereoRig, depth_m: float) -> tuple[Array, tuple[Array, Array]]:
    """Points (n, 3) that both cameras see, in rectified axes from the left camera's center in
    water; and their raw pixels.
    """
    left, right, _ = cameras_in_water(rig)
    if not isinstance(left, CameraInWater) or not isinstance(right, CameraInWater):
        raise CalibrationError("the rig has no flat port: there is no refraction")
    plan = plan_rectification(rig)
    pair, R_left = plan.matching_pair, plan.R_left_matching
    width, height = pair.image_size
    x, y = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    slopes = (
        np.column_stack([x.ravel(), y.ravel()]) - [pair.cx_left_px, pair.cy_px]
    ) / pair.focal_px
    points = np.column_stack([slopes, np.ones(len(slopes))]) * depth_m
    before_left = points @ R_left + left.center_m
    before_right = before_left @ rig.R.T + rig.T_right_left[:3, 3]
    pixels = [left.project_points(before_left), right.project_points(before_right)]
    with np.errstate(invalid="ignore"):
        inside = np.all(
            [((p >= 0) & (p <= [width - 1, height - 1])).all(axis=1) for p in pixels], axis=0
        )
    return points[inside], (pixels[0][inside], pixels[1][inside])
