"""Markers in three dimensions: rays through corners meet the plane that stereo measured there.

A corner's own range is as rough as any pixel's; the plane averages all of the marker, and the rays
are known to a twentieth of a pixel.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from calibration import RectifiedPair
from calibration.robust_statistics import TUKEY, biweight, deviation_about_zero
from stereo_seecolor.mapping.marker_detection import MarkerObservation
from stereo_seecolor.records import Array, SurveyFrame


@dataclass(frozen=True)
class PlacingSettings:
    """When a marker counts as measured."""

    fewest_px: int = 60  # with a range on it
    covered: float = 0.3  # of its pixels: else the plane hangs on an edge
    rounds: int = 4  # of the robust fit
    corner_px: float = 0.05  # standard error of a corner in the image (synthetic: 0.03)
    alike_px: float = 40.0  # pixels that share one error of the disparity: a window of matching
    # standard error of a disparity that was averaged: what rectification leaves
    least_px: float = 0.02


SETTINGS = PlacingSettings()


@dataclass(frozen=True, eq=False)
class PlacedSighting:
    """A marker in one camera.

    corners_m: (4, 3) in the camera's axes. frame: its name. std: (2,) standard errors of a corner's
    direction (rad) and of its inverse depth (1/m).
    """

    number: int
    frame: str
    corners_m: Array
    std: tuple[float, float] = (0.0, 0.0)

    @property
    def edges_m(self) -> Array:
        """The lengths of its sides: (4,)."""
        return np.asarray(
            np.linalg.norm(np.roll(self.corners_m, -1, axis=0) - self.corners_m, axis=1)
        )


def place(
    observation: MarkerObservation, frame: SurveyFrame, geometry: RectifiedPair
) -> PlacedSighting | None:
    """A marker's corners in three dimensions; None where too little of it has a measured range."""
    inside = np.zeros(frame.range_m.shape, np.uint8)
    cv2.fillConvexPoly(inside, np.rint(observation.corners_px).astype(np.int32), 1)
    rows, columns = np.nonzero(inside)
    known = np.isfinite(frame.range_m[rows, columns])
    if known.sum() < max(SETTINGS.fewest_px, SETTINGS.covered * len(rows)):
        return None
    rows, columns = rows[known], columns[known]
    disparity = geometry.disparity_from_depth(geometry.depth_from_range(frame.range_m))[
        rows, columns
    ]
    plane, spread_px = _plane(
        np.stack([columns, rows], axis=-1).astype(np.float64), np.asarray(disparity, np.float64)
    )
    corners = np.concatenate([observation.corners_px, np.ones((4, 1))], axis=1)
    depth_m = (
        geometry.focal_px
        * geometry.baseline_m
        / (corners @ plane + geometry.cx_right_px - geometry.cx_left_px)
    )
    x = (corners[:, 0] - geometry.cx_left_px) / geometry.focal_px
    y = (corners[:, 1] - geometry.cy_px) / geometry.focal_px
    of_mean_px = max(spread_px * float(np.sqrt(SETTINGS.alike_px / len(rows))), SETTINGS.least_px)
    # twice that of the middle: the plane turns
    at_corner = 2 * of_mean_px / (geometry.focal_px * geometry.baseline_m)
    std = SETTINGS.corner_px / geometry.focal_px, at_corner
    return PlacedSighting(
        observation.number, frame.name, np.stack([x * depth_m, y * depth_m, depth_m], axis=-1), std
    )


def _plane(pixels: Array, disparity: Array) -> tuple[Array, float]:
    """(3,) of disparity = a column + b row + c: a plane in space is one in disparity, where the
    errors of stereo are even.

    And by how much disparities scatter about it, pixels.
    """
    basis = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
    weight = np.ones(len(basis))
    plane, spread_px = np.zeros(3), 0.0
    for _ in range(SETTINGS.rounds):
        scaled = basis * weight[:, None]
        plane = np.asarray(
            np.linalg.lstsq(scaled.T @ basis, scaled.T @ disparity, rcond=None)[0], np.float64
        )
        off = basis @ plane - disparity
        spread_px = max(deviation_about_zero(off), 1e-6 / TUKEY)
        weight = biweight(off / (TUKEY * spread_px))
    return plane, spread_px
