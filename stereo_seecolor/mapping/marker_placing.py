"""Markers in three dimensions: rays through the corners meet the plane that stereo measured on the
marker.

A corner's own range is as rough as any pixel's; the plane averages all of the marker, and the rays
are known to a twentieth of a pixel.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import RectifiedPair
from stereo_seecolor.geometry import transformed
from stereo_seecolor.mapping.marker_detection import MarkerObservation
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.robust_statistics import TUKEY, biweight, deviation_about_zero

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlacingSettings:
    """When a marker counts as measured."""

    fewest_px: int = 60  # with a range on it
    covered: float = 0.3  # of its pixels: else the plane hangs on an edge
    rounds: int = 4  # of the robust fit
    corner_px: float = 0.05  # standard error of a corner in the image (drawn: 0.03)
    alike_px: float = 40.0  # pixels that share one error of the disparity: a window of matching
    # standard error of a disparity that was averaged: what rectification leaves
    least_px: float = 0.02


PLACING_SETTINGS = PlacingSettings()


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
    """Compute a marker's corners in three dimensions; None where too little of it has a measured
    range.
    """
    inside = np.zeros(frame.range_m.shape, np.uint8)
    cv2.fillConvexPoly(inside, np.rint(observation.corners_px).astype(np.int32), 1)
    rows, columns = np.nonzero(inside)
    known = np.isfinite(frame.range_m[rows, columns])
    if known.sum() < max(PLACING_SETTINGS.fewest_px, PLACING_SETTINGS.covered * len(rows)):
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
    of_mean_px = max(
        spread_px * float(np.sqrt(PLACING_SETTINGS.alike_px / len(rows))), PLACING_SETTINGS.least_px
    )
    # twice that of the middle: the plane turns
    at_corner = 2 * of_mean_px / (geometry.focal_px * geometry.baseline_m)
    std = PLACING_SETTINGS.corner_px / geometry.focal_px, at_corner
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
    for _ in range(PLACING_SETTINGS.rounds):
        scaled = basis * weight[:, None]
        plane = np.asarray(
            np.linalg.lstsq(scaled.T @ basis, scaled.T @ disparity, rcond=None)[0], np.float64
        )
        off = basis @ plane - disparity
        spread_px = max(deviation_about_zero(off), 1e-6 / TUKEY)
        weight = biweight(off / (TUKEY * spread_px))
    return plane, spread_px


# Markers in the map: position, agreement of the observations, and size compared with the given one.


@dataclass(frozen=True)
class MarkerSettings:
    """When a size disagrees."""

    wrong_size: float = 0.02  # off by more than this fraction, and by more than
    # standard errors: no rig's scale is off so far, so it is the size that was given
    wrong_sigmas: float = 5.0
    fewest_views: int = 2  # a marker seen once may be none


MARKER_SETTINGS = MarkerSettings()


@dataclass(frozen=True, eq=False)
class PlacedMarker:
    """A marker in the map.

    number: of the marker. views: frames behind it. x_m, y_m, z_m: its middle in the map's world.
    residual_m: RMS distance of the middles of its observations, through the track, from that.
    edge_m: mean length of its sides, with its standard error.
    """

    number: int
    views: int
    x_m: float
    y_m: float
    z_m: float
    residual_m: float
    edge_m: float
    edge_std_m: float

    @property
    def place_m(self) -> Array:
        """The middle of the marker: (3,)."""
        return np.array([self.x_m, self.y_m, self.z_m])


@dataclass(frozen=True)
class ScaleCheck:
    """Lengths measured over lengths given: 1 where the rig's scale is right, with its standard
    error. wrong: it cannot be.
    """

    ratio: float
    std: float
    lengths: int

    @property
    def wrong(self) -> bool:
        """Tell whether the scale is further off than any rig's can be."""
        off = abs(self.ratio - 1)
        return off > MARKER_SETTINGS.wrong_size and off > MARKER_SETTINGS.wrong_sigmas * self.std


def placed_markers(
    observations: Sequence[PlacedSighting], T_world_camera: dict[str, Array]
) -> list[PlacedMarker]:
    """Place markers from all observations in frames with a pose (4, 4), by number. Markers seen
    once are left out.
    """
    by_number: dict[int, list[PlacedSighting]] = defaultdict(list)
    for observation in observations:
        if observation.frame in T_world_camera:
            by_number[observation.number].append(observation)
    return [
        _marker(number, own, T_world_camera)
        for number, own in sorted(by_number.items())
        if len(own) >= MARKER_SETTINGS.fewest_views
    ]


def _marker(number: int, observations: list[PlacedSighting], T: dict[str, Array]) -> PlacedMarker:
    middles = np.array(
        [transformed(T[each.frame], each.corners_m).mean(axis=0) for each in observations]
    )
    place = np.median(middles, axis=0)
    edges = np.array([each.edges_m.mean() for each in observations])
    residual = float(np.sqrt(((middles - place) ** 2).sum(axis=1).mean()))
    std = float(edges.std(ddof=1) / np.sqrt(len(edges)))
    x_m, y_m, z_m = (float(value) for value in place)
    return PlacedMarker(
        number, len(observations), x_m, y_m, z_m, residual, float(edges.mean()), std
    )


def size_check(markers: Sequence[PlacedMarker], edge_m: float) -> ScaleCheck | None:
    """The markers' edges against the length that all of them have; None without markers."""
    if not markers:
        return None
    weights = np.array([marker.views for marker in markers], np.float64)
    ratios = np.array([marker.edge_m for marker in markers]) / edge_m
    stds = np.array([marker.edge_std_m for marker in markers]) / edge_m
    share = weights / weights.sum()
    return ScaleCheck(float(share @ ratios), float(np.sqrt((share**2) @ (stds**2))), len(markers))


def bar_checks(
    markers: Sequence[PlacedMarker], bars: dict[tuple[int, int], float]
) -> dict[tuple[int, int], ScaleCheck]:
    """Distances of markers' middles against known lengths; a bar of which an end was not found is
    left out.
    """
    found = {marker.number: marker for marker in markers}
    checks = {}
    for (first, second), length_m in bars.items():
        if first in found and second in found:
            a, b = found[first], found[second]
            std = float(np.hypot(a.residual_m / np.sqrt(a.views), b.residual_m / np.sqrt(b.views)))
            checks[first, second] = ScaleCheck(
                float(np.linalg.norm(a.place_m - b.place_m)) / length_m, std / length_m, 1
            )
    return checks
