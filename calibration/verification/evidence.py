"""The evidence about a rig: how rows of matched points disagree over the image and with range, and
by what disparities and the focal length must change for points to move rigidly between pairs
(``motion``); and what is left of it after causes are undone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.resampling import jackknife
from calibration.robust_statistics import deviation_about_zero
from calibration.verification.dive_points import (
    LEAST_POINTS,
    Array,
    DivePoints,
    Reading,
    reading_of,
    seen_twice,
)
from calibration.verification.motion import fit_clear, range_error
from calibration.verification.motion_result import LIMITS as MOTION_LIMITS
from calibration.verification.rigid_motion import ASPECT, COLUMNS, FOCAL, OFFSET, ROWS, SeenTwice
from calibration.verification.row_fits import robust_fit
from calibration.verification.table import CAUSES, MOVED

ROWS_PX = 0.05
"""What a usual lens model leaves in rows that grows evenly over the image."""
REST = 0.1
"""Standard error of the logarithm of what rigid motions leave: of couples that share one rig it is
up to 1.1 times what those leave that have values of their own."""
MOST_LEFT_OUT = 10
"""Pairs that are left out, one by one, for standard errors."""
SHOWN = 400
"""Points whose change by each cause is computed: more tell the same."""


@dataclass(frozen=True, eq=False)
class RigEvidence:
    """What is left of the evidence after causes of these amounts are undone. values, cov: (n,) and
    (n, n), pixels. rest_px: what rigid motions leave of couples, NaN without these.

    left, right: (m, 2) rectified pixels of some points.
    """

    causes: tuple[int, ...]
    amounts: Array
    values: Array
    cov: Array
    rest_px: float
    reading: Reading
    left: Array
    right: Array

    @classmethod
    def of(cls, points: DivePoints, causes: tuple[int, ...], amounts: Array) -> "RigEvidence":
        """Raises LinAlgError where points hold no evidence."""
        geometry, reading = points.geometry, reading_of(points.rig, causes, amounts)
        left, right = points.read(reading, points.left, points.right)
        disparity = left[:, 0] - right[:, 0]
        seen = np.isfinite(disparity)
        if seen.sum() < LEAST_POINTS or not np.median(disparity[seen]) > 1:
            raise np.linalg.LinAlgError("too few points")
        left, right, disparity = left[seen], right[seen], disparity[seen]
        rows = right[:, 1] - left[:, 1]
        values, cov = _row_evidence(right, disparity, rows, points.pairs[seen], geometry)
        rest_px = float("nan")
        if points.couples:
            couples = [seen_twice(points, reading, couple) for couple in points.couples]
            moved, moved_cov, rest_px = _motion_evidence(couples, geometry)
            none = np.zeros((len(values), len(moved)))
            values = np.concatenate([values, moved])
            cov = np.block([[cov, none], [none.T, moved_cov]])
        step = -(-len(left) // SHOWN)
        return cls(causes, amounts, values, cov, rest_px, reading, left[::step], right[::step])

    def with_one(self, points: DivePoints, cause: int) -> tuple[tuple[int, ...], Array, float]:
        """These causes with one more, the amounts that would leave the least if the evidence were
        in proportion, and what that is, in squared standard errors.
        """
        causes = (*self.causes, cause)
        amounts = np.append(self.amounts, 0.0)
        step, rest = self.step(slopes_of(points, self, causes, amounts))
        return causes, amounts + step, rest

    def step(self, slopes: Array) -> tuple[Array, float]:
        """By what the amounts of causes with these slopes must change to leave the least, in
        proportion; and what that is, in squared standard errors.
        """
        if not np.isfinite(slopes).all():
            return np.zeros(slopes.shape[1]), np.inf
        white, predicted = self.whiten @ self.values, self.whiten @ slopes
        step = np.linalg.lstsq(predicted, white, rcond=None)[0]
        rest = white - predicted @ step
        return np.asarray(step), float(rest @ rest)

    def times_chance(self, errors: "RigEvidence") -> float:
        """How many times what chance leaves is left, 1 at least: what is not understood makes all
        errors larger.
        """
        free = max(len(self.values) - len(self.causes), 1)
        return max(1.0, self.misfit(errors) / free)

    def relative_to_disparity(self, points: DivePoints) -> float:
        """What is left of the rows over the image, or of the motion over the median disparity."""
        disparity = self.left[:, 0] - self.right[:, 0]
        middle_px = float(np.median(disparity))
        terms = _terms(self.right, disparity, points.geometry)
        rows = most_of(np.abs(terms @ self.values[: terms.shape[1]])) / middle_px
        if not points.couples:
            return rows
        return max(rows, abs(float(range_error(self.values[-4], self.values[-3], middle_px))))

    def cov_of_amounts(self, slopes: Array) -> Array:
        """(causes, causes) of the amounts."""
        predicted = self.whiten @ slopes
        return np.asarray(np.linalg.pinv(predicted.T @ predicted))

    @cached_property
    def whiten(self) -> Array:
        """(n, n) makes the evidence one of standard errors."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.cov)))

    @property
    def unusual(self) -> int:
        """How many causes are no movement of a camera: two at once are no rival of one."""
        return sum(CAUSES[cause].cure != MOVED for cause in self.causes)

    @property
    def size_of_errors(self) -> float:
        """The logarithm of the determinant of their covariance."""
        return float(np.linalg.slogdet(self.cov)[1])

    def misfit(self, errors: "RigEvidence") -> float:
        """What is left, in squared standard errors as ``errors`` has them, with what motions leave
        more than they do there.
        """
        white = errors.whiten @ self.values
        less_rigid = max(float(np.log(self.rest_px / errors.rest_px)), 0.0) / REST
        return float(white @ white) + (less_rigid**2 if self.rest_px == self.rest_px else 0.0)


def slopes_of(points: DivePoints, at: RigEvidence, causes: Sequence[int], amounts: Array) -> Array:
    """(n, causes) the evidence that more of each cause would leave, for an amount of 1: points of
    the dive are taken by the rig with a little more of it, and read as before.
    """
    geometry, reading = points.geometry, Reading(at.reading.rig)
    level = np.column_stack([at.right[:, 0], at.left[:, 1]])
    before = at.left[:, 0] - level[:, 0]
    of_dive = reading.points(at.left / geometry.focal_px, before / geometry.focal_px)
    found = []
    for number, cause in enumerate(causes):
        more = CAUSES[cause].amount.step
        if CAUSES[cause].make is None:
            left, right = at.left, level.copy()
            right[:, 0] -= more * level[:, 1] / (geometry.image_size[1] / 2)
        else:
            taken = reading_of(points.rig, causes, amounts + more * np.eye(len(causes))[number])
            left, right = points.read(reading, *taken.taken(of_dive))
        after = left[:, 0] - right[:, 0]
        use = np.isfinite(before + after + of_dive[:, 2])
        if use.sum() < LEAST_POINTS:
            return np.full((len(at.values), len(causes)), np.nan)
        rows = (right - left)[use, 1]
        terms = _terms(level[use], before[use], geometry)
        change = np.linalg.lstsq(terms, rows, rcond=None)[0]
        if points.couples:
            moved = _predicted_motion(at.left[use], left[use], before[use], after[use], geometry)
            change = np.append(change, moved)
        found.append(change / more)
    return np.column_stack(found)


def _terms(right: Array, disparity: Array, pair: RectifiedPair) -> Array:
    """(n, 7) how rows may disagree: evenly, over rows (scale), over columns (roll), as after a yaw
    and a pitch, by the lenses, and with range; 1 at the edges of the image.
    """
    x, y = (right / (np.array(pair.image_size) / 2)).T
    far = disparity / np.median(disparity) - 1
    return np.column_stack([np.ones_like(x), y, x, x * y, y**2, y * (x**2 + y**2), far])


def _row_evidence(
    right: Array, disparity: Array, rows: Array, numbers: NDArray[np.int64], pair: RectifiedPair
) -> tuple[Array, Array]:
    """(7,) amounts of the terms, pixels, and their covariance, with that of a usual lens model."""
    terms = _terms(right, disparity, pair)
    values, rest = robust_fit(terms, rows)
    pairs = np.unique(numbers)
    without = [
        robust_fit(terms[numbers != one], rows[numbers != one])[0] for one in pairs[:MOST_LEFT_OUT]
    ]
    corner_px = MOTION_LIMITS.lens_rad * float(np.prod(pair.image_size)) / 4 / pair.focal_px
    lens_px = np.array([ROWS_PX] * 3 + [corner_px] * 3 + [ROWS_PX])
    formal = np.asarray(
        deviation_about_zero(rest) ** 2 * np.linalg.inv(terms.T @ terms), np.float64
    )
    between = jackknife(np.array(without)) if len(pairs) > 1 else np.zeros(len(values))
    return values, np.asarray(np.diag(between**2 + lens_px**2) + formal)


def _motion_evidence(
    couples: Sequence[SeenTwice], pair: RectifiedPair
) -> tuple[Array, Array, float]:
    """(5,) focal length across the baseline, offset, focal length, and disparities over rows and
    columns, and their covariance, with that of a usual lens model; and what motions leave beside
    these, pixels.
    """
    chosen = [ASPECT, OFFSET, FOCAL, ROWS, COLUMNS]
    fitted, free = fit_clear(couples, pair)
    off = (fitted.partial - fitted.partial.mean(axis=0))[:, chosen]
    lens_px = MOTION_LIMITS.lens_rad * pair.focal_px
    lens = np.array(
        [MOTION_LIMITS.focal / 2, lens_px, MOTION_LIMITS.focal, lens_px / 2, lens_px / 2]
    )
    between = (len(couples) - 1) / len(couples) * off.T @ off
    cov = between + np.diag(fitted.formal[chosen] ** 2 + lens**2)
    cov[2, 2] += FOCAL not in free
    return fitted.values[chosen], np.asarray(cov, np.float64), fitted.rest_px


def _predicted_motion(
    left: Array, left_now: Array, before: Array, after: Array, pair: RectifiedPair
) -> Array:
    """(5,) what would be seen of disparities and focal lengths: points of left images, as they lie
    now, are turned (which no motion shows), enlarged and stretched against before.
    """
    (x, y), one = left.T / pair.focal_px, np.ones(len(left))
    moved = (left_now - left).T
    terms = np.concatenate(
        [
            np.column_stack([one + x**2, x * y, -y, left[:, 0], 0 * y]),
            np.column_stack([x * y, one + y**2, x, left[:, 1], left[:, 1]]),
        ]
    )
    focal, aspect = np.linalg.lstsq(terms, moved.ravel(), rcond=None)[0][3:]
    half = np.array(pair.image_size) / 2
    over = np.column_stack([one, left[:, 1] / half[1], left[:, 0] / half[0]])
    offset, rows, columns = np.linalg.lstsq(over, focal * before - (after - before), rcond=None)[0]
    return np.array([aspect, offset, focal, rows, columns])


def most_of(values: Array) -> float:
    """Compute the largest of values, without the uppermost twentieth."""
    return float(np.quantile(values, 0.95))
