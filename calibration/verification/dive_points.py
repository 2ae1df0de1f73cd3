"""Points of a dive that both cameras saw, in raw pixels, so that they can be read with the rig as
calibrated and with the rig as a cause makes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.rectification import (
    plan_rectification,
    raw_points,
    rectified_slopes,
    upright_rotations,
)
from calibration.refraction import cameras_in_water
from calibration.rig import StereoRig, quarter_turn
from calibration.transforms import transform_points
from calibration.verification.matches import Matches
from calibration.verification.motion_result import LIMITS as MOTION_LIMITS
from calibration.verification.rigid_motion import SeenTwice
from calibration.verification.row_fits import row_inliers
from calibration.verification.table import CAUSES

Array = NDArray[np.float64]
LEAST_POINTS = 20
"""Of a pair."""
MOST_OF_A_PAIR = 500
"""Points, spread evenly: more cost time, and errors of a pair are alike anyway."""


@dataclass(frozen=True, eq=False)
class DivePoints:
    """What was seen: (n, 2) raw pixels of points that agree about the rows, with the number of the
    pair of each; and for each couple four arrays (m, 2) of raw pixels: left and right at the first
    moment, left and right at the second.

    rig, geometry: as calibrated; all pixels of the evidence are of its focal length.
    """

    rig: StereoRig
    geometry: RectifiedPair
    left: Array
    right: Array
    pairs: NDArray[np.int64]
    couples: tuple[tuple[Array, ...], ...]

    @classmethod
    def of(
        cls, rig: StereoRig, matches: Sequence[Matches], couples: Sequence[SeenTwice]
    ) -> "DivePoints | None":
        """Take the points of matches that agree about the rows; None where they are too few."""
        geometry = plan_rectification(rig).matching_pair
        sides = []
        for one in (one for one in matches if len(one.left) >= LEAST_POINTS):
            kept = np.flatnonzero(row_inliers(one.left, one.right, geometry))
            kept = kept[:: -(-len(kept) // MOST_OF_A_PAIR) or 1]
            sides.append((one.left[kept], one.right[kept]))
        if sum(len(left) for left, _ in sides) < LEAST_POINTS:
            return None
        numbers = np.repeat(np.arange(len(sides)), [len(left) for left, _ in sides])
        left, right = raw_points(
            rig, *(np.concatenate([one[side] for one in sides]) for side in (0, 1))
        )
        twice = [
            tuple(raw for sides in couple.pixels(geometry) for raw in raw_points(rig, *sides))
            for couple in couples
            if len(couple.first) >= LEAST_POINTS
        ]
        enough = len(twice) >= MOTION_LIMITS.least_couples
        return cls(rig, geometry, left, right, numbers, tuple(twice) if enough else ())

    def read(self, by: "Reading", left: Array, right: Array) -> tuple[Array, Array]:
        """(n, 2) rectified pixels of raw ones, from the principal points."""
        half_px = self.geometry.image_size[1] / 2
        at_left, at_right = by.slopes(left, right)
        at_left, at_right = at_left * self.geometry.focal_px, at_right * self.geometry.focal_px
        at_right[:, 0] += by.shutters_px * at_right[:, 1] / half_px
        return at_left, at_right


@dataclass(frozen=True, eq=False)
class Reading:
    """A rig that reads raw pixels, and shutters."""

    rig: StereoRig
    shutters_px: float = 0.0

    @cached_property
    def _turns(self) -> tuple[Array, Array]:
        R_left, R_right, turns = upright_rotations(cameras_in_water(self.rig)[2])
        return quarter_turn(-turns) @ R_left, quarter_turn(-turns) @ R_right

    def slopes(self, left: Array, right: Array) -> tuple[Array, Array]:
        """(n, 2) rectified slopes of raw pixels; NaN where a lens does not reach."""
        at_left, at_right, _ = cameras_in_water(self.rig)
        R_left, R_right = self._turns
        return rectified_slopes(at_left, R_left, left), rectified_slopes(at_right, R_right, right)

    def points(self, left: Array, disparity: Array) -> Array:
        """(n, 3) meters from the left camera, of slopes and disparity; NaN behind infinity."""
        depth_m = np.linalg.norm(cameras_in_water(self.rig)[2][:3, 3]) / np.where(
            disparity > 0, disparity, np.nan
        )
        rays = np.column_stack([left, np.ones(len(left))]) * depth_m[:, None]
        return np.asarray(rays @ self._turns[0])

    def taken(self, points: Array) -> tuple[Array, Array]:
        """(n, 2) raw pixels of points (n, 3)."""
        left, right, T = cameras_in_water(self.rig)
        return left.project(points), right.project(transform_points(T, points))


def reading_of(rig: StereoRig, causes: Sequence[int], amounts: Array) -> Reading:
    """The rig as causes make it."""
    shutters_px = 0.0
    for cause, amount in zip(causes, amounts, strict=True):
        make = CAUSES[cause].make
        if make is None:
            shutters_px += float(amount)
        else:
            rig = make(rig, float(amount))
    return Reading(rig, shutters_px)


def seen_twice(points: DivePoints, reading: Reading, couple: Sequence[Array]) -> SeenTwice:
    """The points of a couple as a rig reads them."""
    sides, rows_px = [], []
    for raw in (couple[:2], couple[2:]):
        left, right = points.read(reading, raw[0], raw[1])
        sides.append(np.column_stack([left, left[:, 0] - right[:, 0]]))
        rows_px.append(right[:, 1] - left[:, 1])
    seen = np.isfinite(sides[0]).all(axis=1) & np.isfinite(sides[1]).all(axis=1)
    if seen.sum() < LEAST_POINTS:
        raise np.linalg.LinAlgError("too few points")
    return SeenTwice(sides[0][seen], sides[1][seen], np.column_stack(rows_px)[seen])
