"""What explains the rows and the motion of a dive: the causes of the table, each tested against all
others on the same evidence.

The evidence: how rows of matched points disagree over the image and with range, and by what
disparities and the focal length must change for points to move rigidly between pairs (``motion``).
A cause is tested by its undoing: the points are read with the rig as the cause makes it, by the
amount that leaves the least evidence (Gauss-Newton), so that large amounts are tested as small ones
are. Of causes that explain as much, all are named.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import comb, log

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry import RectifiedPair
from calibration.rectification import (
    plan_rectification,
    raw_points,
    rectified_slopes,
    upright_rotations,
)
from calibration.refraction import cameras_in_water
from calibration.resampling import jackknife
from calibration.rig import StereoRig, quarter_turn
from calibration.verification.matches import Matches
from calibration.verification.motion import LIMITS as MOTION_LIMITS
from calibration.verification.motion import NO_MOTION, Motion, fit_clear, motion_of, range_error
from calibration.verification.rigid_motion import COLUMNS, FOCAL, OFFSET, ROWS, SeenTwice
from calibration.verification.row_fits import robust_fit, row_inliers
from calibration.verification.table import CAUSES, LENSES, MOVED, Cause

Array = NDArray[np.float64]

PENALTY = 9.0
"""Of an amount more, in squared standard errors: chance reaches three in one of 370."""
ALIKE = 6.0
"""Squared standard errors by which a rival may fit worse: it is then up to 20 times less likely."""
ENOUGH = 3.0
"""Squared standard errors for each number of the evidence that a good explanation may leave."""
MOST_TOGETHER = 3
"""Causes at once: of more, several sets explain the same."""
RANGE_ERROR, DEVIATIONS = 0.02, 2.0
"""Ranges are wrong where they are by more than both."""
ROWS_PX = 0.05
"""What a usual lens model leaves in rows that grows evenly over the image."""
REST = 0.1
"""Standard error of the logarithm of what rigid motions leave: of couples that share one rig it is
up to 1.1 times what those leave that have values of their own."""
LEAST_POINTS = 20
"""Of a pair."""
MOST_LEFT_OUT = 10
"""Pairs that are left out, one by one, for standard errors."""
SHOWN = 400
"""Points whose change by each cause is computed: more tell the same."""
MEASURED = 2000
"""Points whose range is measured: of ranges that are wrong by 100 % at the edges, the median of so
many is good to 3 %."""
MOST_OF_A_PAIR = 500
"""Points, spread evenly: more cost time, and errors of a pair are alike anyway."""
MOST_TRIED = 8
"""Sets of two or more causes that promise about as much as the best one."""
ROUNDS = 8
"""Of Gauss-Newton: a focal length of half the size takes five."""
HOPELESS = 10.0
"""Times what a good explanation may leave: what leaves more in proportion is not tried where
another one is good."""
CONVERGED = 0.1
"""Of a standard error."""
CONTINUED = 4
"""Sets of causes that are continued by one more, and that are tried at least of those with one
more."""


@dataclass(frozen=True)
class Explanation:
    """Causes that explain the evidence together. text: with their amounts.

    misfit: squared standard errors that they leave. range_error, range_std:
    of ranges, median over the image, relative, with the offset that a usual lens model leaves and
    what the motion contradicts. is_wrong: ranges are off by more than 2 % and two standard errors
    of the amounts.
    edge_error: the largest over the image (95 of 100 points).
    """

    text: str
    causes: tuple[Cause, ...]
    misfit: float
    range_error: float = 0.0
    range_std: float = 0.0
    edge_error: float = 0.0
    is_wrong: bool = False

    @property
    def is_movement(self) -> bool:
        """Tell whether it is a movement of a camera alone, which refining finds."""
        return bool(self.causes) and all(cause.cure == MOVED for cause in self.causes)

    @property
    def ranges(self) -> str:
        """What it does to ranges."""
        if not self.is_wrong and abs(self.range_error) <= RANGE_ERROR:
            return "ranges are right to 2 %, or two standard errors"
        sure = "" if self.is_wrong else ", within two standard errors"
        return (
            f"ranges may be off by {100 * self.range_error:+.0f} +- {100 * self.range_std:.0f} %, "
            f"by up to {100 * self.edge_error:.0f} % over the image{sure}"
        )


@dataclass(frozen=True)
class Causes:
    """best: what explains the evidence by the fewest causes; rivals: others as few that explain it
    as well. numbers: of the evidence, 0 where it was not tested. left: what the best leaves of the
    rows, most over the image, and of the motion, relative to the median disparity.

    motion: between neighboring pairs, with the best undone; NO_MOTION where none was given. rig:
    with the best undone, None where it was not tested.
    """

    best: Explanation | None = None
    rivals: tuple[Explanation, ...] = ()
    numbers: int = 0
    left: float = 0.0
    motion: Motion = NO_MOTION
    rig: StereoRig | None = None

    @property
    def explains(self) -> bool:
        """Tell whether the best leaves no more than chance does."""
        return self.best is not None and self.best.misfit <= ENOUGH * self.numbers

    @property
    def explains_motion(self) -> bool:
        """Tell whether there is a cause that explains the motion with all else."""
        named = self.explains and self.best is not None and self.best.text
        return bool(named and self.motion.couples) and not (
            self.motion.between_px or self.motion.is_misfit
        )

    @property
    def is_wrong(self) -> bool:
        """Tell whether ranges are wrong by the best explanation, or by one as good, or may be by
        what no cause explains.
        """
        unknown = self.best is not None and not self.explains and self.left > RANGE_ERROR
        return bool(self._wrong) or unknown

    @property
    def _wrong(self) -> list[Explanation]:
        return [one for one in self._all if one.is_wrong]

    @property
    def _all(self) -> list[Explanation]:
        return [one for one in (self.best, *self.rivals) if one]

    @property
    def has_moved(self) -> bool:
        """Tell whether the best is a movement of a camera alone, which refining finds."""
        return self.best is not None and self.best.is_movement

    @property
    def is_wrong_if_refined(self) -> bool:
        """Tell whether ranges are wrong by the best, or by one as good, and refining, which takes
        all for a movement of a camera, would hide it.
        """
        return not all(one.is_movement for one in self._wrong)

    @property
    def may_be_lens(self) -> bool:
        """Tell whether ranges are wrong by what may be another distortion of a lens."""
        return any(set(one.causes) & set(LENSES) for one in self._wrong)

    def is_(self, cause: Cause) -> bool:
        """Tell whether this cause alone explains all, as the best."""
        return self.explains and self.best is not None and self.best.causes == (cause,)

    def agrees_with(self, motion: Motion) -> bool:
        """Tell whether the best says of ranges what the motion alone says."""
        if self.best is None or motion.measured is None:
            return False
        std = float(np.hypot(self.best.range_std, motion.range_std))
        return abs(self.best.range_error - motion.range_error) < DEVIATIONS * std

    @property
    def line(self) -> str:
        """The best and the rivals that say otherwise of ranges, what they do to these, and what to
        do; what is left where none explains all; "" where nothing is to be explained.
        """
        if self.best is None or not (self.best.text or not self.explains):
            return ""
        if not self.explains:
            times = float(np.sqrt(self.best.misfit / self.numbers))
            return (
                "no cause that was tested explains it: the best one leaves "
                f"{times:.1f} times what points and usual lens models leave; the error of "
                "ranges is unknown: several faults at once, moving things, or pairs that are not "
                "of one moment: calibrate again, and compare a known length"
            )
        # of rivals that leave ranges right one is enough, and none where the best does as well
        harmless = [one for one in self._all if not one.is_wrong][:1]
        named = [one for one in self.rivals if one.is_wrong or one in harmless]
        rivals = "".join(f"; as likely: {one.text}: {one.ranges}" for one in named)
        cures = dict.fromkeys(cause.cure for one in (self.best, *named) for cause in one.causes)
        return f"{self.best.text}: {self.best.ranges}{rivals}: {'; '.join(cures)}"


NOT_TESTED = Causes()


def find_causes(
    rig: StereoRig, matches: Sequence[Matches], couples: Sequence[SeenTwice] = ()
) -> Causes:
    """Fit all causes to the rows of matches in the rig's rectified images, and to what couples of
    neighboring pairs show.

    Not tested where they show too few points.
    """
    points = _Points.of(rig, matches, couples)
    if points is None:
        return NOT_TESTED
    try:
        start = _Undone.of(points, (), np.zeros(0))
    except np.linalg.LinAlgError:  # all points in one place, or couples that fit no motion
        return find_causes(rig, matches) if points.couples else NOT_TESTED
    best, continued = [start], [start]
    for together in range(1, MOST_TOGETHER + 1):
        if best[0].misfit(best[0]) < PENALTY:
            break
        fits = _with_one_more(points, continued)
        if not fits:
            break
        # with errors as the best leaves them: a wrong rig has larger ones, which hide its misfit
        least = min((*best, *fits), key=lambda fit: fit.size_of_errors)
        fits.sort(key=lambda fit: fit.misfit(least))
        continued = fits[:CONTINUED]
        fits = [fit for fit in fits if _is_plausible(points, fit, least)]
        if not fits:
            continue
        misfit, times = fits[0].misfit(least), fits[0].times_chance(least)
        # of more sets one explains more by chance (extended BIC, Chen and Chen 2008)
        chance = 2 * log(comb(len(CAUSES), together) / len(CAUSES))
        if misfit < best[0].misfit(least) - (PENALTY + chance) * times:
            best = [fit for fit in fits if fit.misfit(least) < misfit + ALIKE]
    best.sort(key=lambda fit: fit.unusual)  # of those that explain as much the most usual
    best = [fit for fit in best if fit.unusual < 2 or fit.unusual == best[0].unusual]
    explained = [_explanation(fit, points, best[0]) for fit in best]
    return Causes(
        explained[0],
        tuple(explained[1:]),
        len(start.values),
        best[0].relative_to_disparity(points),
        _motion_left(points, best[0]),
        best[0].reading.rig,
    )


@dataclass(frozen=True, eq=False)
class _Points:
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
    ) -> "_Points | None":
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

    def read(self, by: "_Reading", left: Array, right: Array) -> tuple[Array, Array]:
        """(n, 2) rectified pixels of raw ones, from the principal points."""
        half_px = self.geometry.image_size[1] / 2
        at_left, at_right = by.slopes(left, right)
        at_left, at_right = at_left * self.geometry.focal_px, at_right * self.geometry.focal_px
        at_right[:, 0] += by.shutters_px * at_right[:, 1] / half_px
        return at_left, at_right


@dataclass(frozen=True, eq=False)
class _Reading:
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
        """(n, 3) meters from the left camera, of rectified slopes and their disparity; NaN behind
        infinity.
        """
        depth_m = np.linalg.norm(cameras_in_water(self.rig)[2][:3, 3]) / np.where(
            disparity > 0, disparity, np.nan
        )
        rays = np.column_stack([left, np.ones(len(left))]) * depth_m[:, None]
        return np.asarray(rays @ self._turns[0])

    def taken(self, points: Array) -> tuple[Array, Array]:
        """(n, 2) raw pixels of points (n, 3)."""
        left, right, T = cameras_in_water(self.rig)
        return left.project(points), right.project(points @ T[:3, :3].T + T[:3, 3])


def _reading(rig: StereoRig, causes: Sequence[int], amounts: Array) -> _Reading:
    """The rig as causes make it."""
    shutters_px = 0.0
    for cause, amount in zip(causes, amounts, strict=True):
        make = CAUSES[cause].make
        if make is None:
            shutters_px += float(amount)
        else:
            rig = make(rig, float(amount))
    return _Reading(rig, shutters_px)


@dataclass(frozen=True, eq=False)
class _Undone:
    """What is left of the evidence after causes of these amounts are undone. values, cov: (n,) and
    (n, n), pixels. rest_px: what rigid motions leave of couples, NaN without these.

    left, right: (m, 2) rectified pixels of some points.
    """

    causes: tuple[int, ...]
    amounts: Array
    values: Array
    cov: Array
    rest_px: float
    reading: _Reading
    left: Array
    right: Array

    @classmethod
    def of(cls, points: _Points, causes: tuple[int, ...], amounts: Array) -> "_Undone":
        """Raises LinAlgError where points hold no evidence."""
        geometry, reading = points.geometry, _reading(points.rig, causes, amounts)
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
            couples = [_seen_twice(points, reading, couple) for couple in points.couples]
            moved, moved_cov, rest_px = _motion_evidence(couples, geometry)
            none = np.zeros((len(values), len(moved)))
            values, cov = (
                np.concatenate([values, moved]),
                np.block([[cov, none], [none.T, moved_cov]]),
            )
        step = -(-len(left) // SHOWN)
        return cls(causes, amounts, values, cov, rest_px, reading, left[::step], right[::step])

    def with_one(self, points: _Points, cause: int) -> tuple[tuple[int, ...], Array, float]:
        """These causes with one more, the amounts that would leave the least if the evidence were
        in proportion, and what that is, in squared standard errors.
        """
        causes = (*self.causes, cause)
        amounts = np.append(self.amounts, 0.0)
        step, rest = self.step(_slopes(points, self, causes, amounts))
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

    def times_chance(self, errors: "_Undone") -> float:
        """How many times what chance leaves is left, 1 at least: what is not understood makes all
        errors larger.
        """
        free = max(len(self.values) - len(self.causes), 1)
        return max(1.0, self.misfit(errors) / free)

    def relative_to_disparity(self, points: _Points) -> float:
        """What is left of the rows, most over the image, or of the motion, over the median
        disparity.
        """
        disparity = self.left[:, 0] - self.right[:, 0]
        middle_px = float(np.median(disparity))
        terms = _terms(self.right, disparity, points.geometry)
        rows = _most(np.abs(terms @ self.values[: terms.shape[1]])) / middle_px
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

    def misfit(self, errors: "_Undone") -> float:
        """What is left, in squared standard errors as ``errors`` has them, with what motions leave
        more than they do there.
        """
        white = errors.whiten @ self.values
        less_rigid = max(float(np.log(self.rest_px / errors.rest_px)), 0.0) / REST
        return float(white @ white) + (less_rigid**2 if self.rest_px == self.rest_px else 0.0)


def _motion_left(points: _Points, at: _Undone) -> Motion:
    if not points.couples:
        return NO_MOTION
    couples = [_seen_twice(points, at.reading, couple) for couple in points.couples]
    return motion_of(couples, points.geometry)


def _seen_twice(points: _Points, reading: _Reading, couple: Sequence[Array]) -> SeenTwice:
    """The points of a couple as a rig reads them."""
    sides = []
    for raw in (couple[:2], couple[2:]):
        left, right = points.read(reading, raw[0], raw[1])
        sides.append(np.column_stack([left, left[:, 0] - right[:, 0]]))
    seen = np.isfinite(sides[0]).all(axis=1) & np.isfinite(sides[1]).all(axis=1)
    if seen.sum() < LEAST_POINTS:
        raise np.linalg.LinAlgError("too few points")
    return SeenTwice(sides[0][seen], sides[1][seen])


def _slopes(points: _Points, at: _Undone, causes: Sequence[int], amounts: Array) -> Array:
    """(n, causes) the evidence that more of each cause would leave, for an amount of 1: points of
    the dive are taken by the rig with a little more of it, and read as before.
    """
    geometry, reading = points.geometry, _Reading(at.reading.rig)
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
            taken = _reading(points.rig, causes, amounts + more * np.eye(len(causes))[number])
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


def _with_one_more(points: _Points, continued: Sequence[_Undone]) -> list[_Undone]:
    """Sets of causes with one more, those that promise the most, fitted."""
    promising: dict[tuple[int, ...], tuple[float, tuple[int, ...], Array]] = {}
    for at in continued:
        for cause in sorted(set(range(len(CAUSES))) - set(at.causes)):
            causes, amounts, rest = at.with_one(points, cause)
            key = tuple(sorted(causes))
            if rest < min(at.misfit(at) - PENALTY, promising.get(key, (np.inf,))[0]):
                promising[key] = rest, causes, amounts
    most = CONTINUED if continued[0].causes else len(CAUSES)
    chosen = sorted(promising.values(), key=lambda one: one[0])
    alike = [one for one in chosen if one[0] < chosen[0][0] + ALIKE]
    chosen = chosen[: max(most, min(len(alike), MOST_TRIED))]
    enough = ENOUGH * len(continued[0].values)
    fits: list[_Undone] = []
    for rest, causes, amounts in chosen:
        if rest > HOPELESS * enough and any(fit.misfit(fit) < enough for fit in fits):
            break
        fit = _fitted(points, causes, amounts)
        fits += [fit] if fit else []
    return fits


def _fitted(points: _Points, causes: tuple[int, ...], amounts: Array) -> _Undone | None:
    """The amounts that leave the least evidence; None where there are none, or they are more than
    any cause makes.
    """
    most = 2 * np.array([CAUSES[cause].amount.most for cause in causes])
    with suppress(CalibrationError, np.linalg.LinAlgError, cv2.error):
        for _ in range(ROUNDS):
            at = _Undone.of(points, causes, np.clip(amounts, -most, most))
            slopes = _slopes(points, at, causes, at.amounts)
            step, rest = at.step(slopes)
            if not np.isfinite(rest):
                return None
            amounts = at.amounts + step
            if (np.abs(step) < CONVERGED * np.sqrt(np.diag(at.cov_of_amounts(slopes)))).all():
                return at
    return None


def _is_plausible(points: _Points, fit: _Undone, least: _Undone) -> bool:
    """Tell whether no amount is larger than any cause makes, or too small to be needed."""
    smallest, most = np.array(
        [(CAUSES[cause].amount.least, CAUSES[cause].amount.most) for cause in fit.causes]
    ).T
    cov = fit.cov_of_amounts(_slopes(points, fit, fit.causes, fit.amounts))
    cov = cov * fit.times_chance(least)
    needed = np.abs(fit.amounts) > np.sqrt(PENALTY * np.diag(cov))
    size = np.abs(fit.amounts)
    return bool(((size >= smallest) & (size < most) & needed).all())


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
    noise_px = 1.4826 * float(np.median(np.abs(rest)))
    corner_px = MOTION_LIMITS.lens_rad * float(np.prod(pair.image_size)) / 4 / pair.focal_px
    lens_px = np.array([ROWS_PX] * 3 + [corner_px] * 3 + [ROWS_PX])
    formal = np.asarray(noise_px**2 * np.linalg.inv(terms.T @ terms), np.float64)
    between = jackknife(np.array(without)) if len(pairs) > 1 else np.zeros(len(values))
    return values, np.asarray(np.diag(between**2 + lens_px**2) + formal)


def _motion_evidence(
    couples: Sequence[SeenTwice], pair: RectifiedPair
) -> tuple[Array, Array, float]:
    """(4,) offset, focal length, and disparities over rows and columns, and their covariance, with
    that of a usual lens model; and what motions leave beside these, pixels.
    """
    chosen = [OFFSET, FOCAL, ROWS, COLUMNS]
    fitted, free = fit_clear(couples, pair)
    off = (fitted.partial - fitted.partial.mean(axis=0))[:, chosen]
    lens_px = MOTION_LIMITS.lens_rad * pair.focal_px
    lens = np.array([lens_px, MOTION_LIMITS.focal, lens_px / 2, lens_px / 2])
    between = (len(couples) - 1) / len(couples) * off.T @ off
    cov = between + np.diag(fitted.formal[chosen] ** 2 + lens**2)
    cov[1, 1] += FOCAL not in free
    return fitted.values[chosen], np.asarray(cov, np.float64), fitted.rest_px


def _predicted_motion(
    left: Array, left_now: Array, before: Array, after: Array, pair: RectifiedPair
) -> Array:
    """(4,) what would be seen of disparities and focal length: points of left images, as they lie
    now, are turned (which no motion shows) and enlarged against before.
    """
    (x, y), one = left.T / pair.focal_px, np.ones(len(left))
    moved = (left_now - left).T
    terms = np.concatenate(
        [
            np.column_stack([one + x**2, x * y, -y, left[:, 0]]),
            np.column_stack([x * y, one + y**2, x, left[:, 1]]),
        ]
    )
    focal = float(np.linalg.lstsq(terms, moved.ravel(), rcond=None)[0][3])
    half = np.array(pair.image_size) / 2
    over = np.column_stack([one, left[:, 1] / half[1], left[:, 0] / half[0]])
    offset, rows, columns = np.linalg.lstsq(over, focal * before - (after - before), rcond=None)[0]
    return np.array([offset, focal, rows, columns])


def _explanation(fit: _Undone, points: _Points, least: _Undone) -> Explanation:
    """least: the errors of the evidence are those that it leaves."""
    misfit = fit.misfit(least)
    if not fit.causes:
        return Explanation("", (), misfit)
    chosen = [CAUSES[cause] for cause in fit.causes]
    cov = fit.cov_of_amounts(_slopes(points, fit, fit.causes, fit.amounts))
    cov = cov * fit.times_chance(least)
    texts = [
        cause.text.format(cause.amount.text(float(amount)), f"{cause.amount.unit * std:.1g}")
        for cause, amount, std in zip(chosen, fit.amounts, np.sqrt(np.diag(cov)), strict=True)
    ]
    off, by_amounts = _range_errors(points, fit)
    middle = np.median(by_amounts, axis=0)
    beside = by_amounts - middle
    disparity_px = float(np.median(fit.left[:, 0] - fit.right[:, 0]))
    of_causes = float(np.sqrt(middle @ cov @ middle))
    parts = [of_causes, MOTION_LIMITS.lens_rad * points.geometry.focal_px / disparity_px]
    if points.couples:  # what the motion contradicts
        offset_px, log_focal = fit.values[-4:-2]
        parts.append(float(range_error(offset_px, log_focal, disparity_px)))
    error = float(np.median(off))
    spread = 1.4826 * float(np.median(np.abs(off - error)))
    std = float(np.linalg.norm([*parts, 1.25 * spread / np.sqrt(len(off))]))
    uneven = _most(np.abs(off - error))
    uneven_std = _most(np.sqrt(((beside @ cov) * beside).sum(axis=1)))
    return Explanation(
        " and ".join(texts),
        tuple(chosen),
        misfit,
        error,
        std,
        _most(np.abs(off)),
        abs(error) > max(RANGE_ERROR, DEVIATIONS * of_causes)
        or uneven > max(RANGE_ERROR, DEVIATIONS * uneven_std),
    )


def _range_errors(points: _Points, fit: _Undone) -> tuple[Array, Array]:
    """(m,) the relative error of each point's range as calibrated, if the causes explain it; and
    (m, causes) by how much it grows with each amount.
    """
    step = -(-len(points.left) // MEASURED)
    raw = points.left[::step], points.right[::step]

    def ranges(reading: _Reading) -> Array:
        left, right = (one / points.geometry.focal_px for one in points.read(reading, *raw))
        return np.asarray(np.linalg.norm(reading.points(left, (left - right)[:, 0]), axis=1))

    as_given, true = ranges(_Reading(points.rig)), ranges(fit.reading)
    off = as_given / true - 1
    grows = []
    for number, cause in enumerate(fit.causes):
        more = CAUSES[cause].amount.step
        amounts = fit.amounts + more * np.eye(len(fit.causes))[number]
        other = as_given / ranges(_reading(points.rig, fit.causes, amounts)) - 1
        grows.append((other - off) / more)
    by_amounts = np.column_stack(grows)
    known = np.isfinite(off) & np.isfinite(by_amounts).all(axis=1)
    return off[known], by_amounts[known]


def _most(values: Array) -> float:
    return float(np.quantile(values, 0.95))
