"""What explains the rows and the motion of a dive: the causes of the table, each tested against all
others on the same evidence (``evidence``).

A cause is tested by its undoing: the points are read with the rig as the cause makes it, by the
amount that leaves the least evidence (Gauss-Newton), so that large amounts are tested as small ones
are. Of causes that explain as much, all are named.
"""

from collections.abc import Sequence
from contextlib import suppress
from math import comb, log

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.rig import StereoRig
from calibration.robust_statistics import deviation_about_zero
from calibration.verification.dive_points import Array, DivePoints, Reading, reading_of, seen_twice
from calibration.verification.evidence import RigEvidence, most_of, slopes_of
from calibration.verification.explanations import (
    DEVIATIONS,
    ENOUGH,
    NOT_TESTED,
    RANGE_ERROR,
    Causes,
    Explanation,
)
from calibration.verification.matches import Matches
from calibration.verification.motion import motion_of, range_error
from calibration.verification.motion_result import LIMITS as MOTION_LIMITS
from calibration.verification.motion_result import NO_MOTION, Motion
from calibration.verification.rigid_motion import SeenTwice
from calibration.verification.table import CAUSES, STRETCHED

PENALTY = 9.0
"""Of an amount more, in squared standard errors: chance reaches three in one of 370."""
ALIKE = 6.0
"""Squared standard errors by which a rival may fit worse: it is then up to 20 times less likely."""
MOST_TOGETHER = 3
"""Causes at once: of more, several sets explain the same."""
MEASURED = 2000
"""Points whose range is measured: of ranges that are wrong by 100 % at the edges, the median of so
many is good to 3 %."""
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


def find_causes(
    rig: StereoRig, matches: Sequence[Matches], couples: Sequence[SeenTwice] = ()
) -> Causes:
    """Fit all causes to the rows of matches in the rig's rectified images, and to what couples of
    neighboring pairs show.

    Not tested where they show too few points.
    """
    points = DivePoints.of(rig, matches, couples)
    if points is None:
        return NOT_TESTED
    try:
        start = RigEvidence.of(points, (), np.zeros(0))
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
    if not points.couples and len(best[0].causes) > 1:
        best += _stretched(points, start, best[0])
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


def _with_one_more(points: DivePoints, continued: Sequence[RigEvidence]) -> list[RigEvidence]:
    """Sets of causes with one more, those that promise the most, fitted."""
    promising: dict[tuple[int, ...], tuple[float, tuple[int, ...], Array]] = {}
    untold = set() if points.couples else {CAUSES.index(cause) for cause in STRETCHED}
    for at in continued:
        for cause in sorted(set(range(len(CAUSES))) - untold - set(at.causes)):
            causes, amounts, rest = at.with_one(points, cause)
            key = tuple(sorted(causes))
            if rest < min(at.misfit(at) - PENALTY, promising.get(key, (np.inf,))[0]):
                promising[key] = rest, causes, amounts
    most = CONTINUED if continued[0].causes else len(CAUSES)
    chosen = sorted(promising.values(), key=lambda one: one[0])
    alike = [one for one in chosen if one[0] < chosen[0][0] + ALIKE]
    chosen = chosen[: max(most, min(len(alike), MOST_TRIED))]
    enough = ENOUGH * len(continued[0].values)
    fits: list[RigEvidence] = []
    for rest, causes, amounts in chosen:
        if rest > HOPELESS * enough and any(fit.misfit(fit) < enough for fit in fits):
            break
        fit = _fitted(points, causes, amounts)
        fits += [fit] if fit else []
    return fits


def _stretched(points: DivePoints, start: RigEvidence, best: RigEvidence) -> list[RigEvidence]:
    """Stretches that explain rows as well as the best does, which takes more causes: rows alone do
    not tell one from two movements.
    """
    tried = [start.with_one(points, CAUSES.index(cause))[:2] for cause in STRETCHED]
    fits = [fit for one in tried if (fit := _fitted(points, *one))]
    most = best.misfit(best) + ALIKE
    return [fit for fit in fits if fit.misfit(best) < most and _is_plausible(points, fit, best)]


def _fitted(points: DivePoints, causes: tuple[int, ...], amounts: Array) -> RigEvidence | None:
    """The amounts that leave the least evidence; None without any, or beyond what causes make."""
    most = 2 * np.array([CAUSES[cause].amount.most for cause in causes])
    with suppress(CalibrationError, np.linalg.LinAlgError, cv2.error):
        for _ in range(ROUNDS):
            at = RigEvidence.of(points, causes, np.clip(amounts, -most, most))
            slopes = slopes_of(points, at, causes, at.amounts)
            step, rest = at.step(slopes)
            if not np.isfinite(rest):
                return None
            amounts = at.amounts + step
            if (np.abs(step) < CONVERGED * np.sqrt(np.diag(at.cov_of_amounts(slopes)))).all():
                return at
    return None


def _is_plausible(points: DivePoints, fit: RigEvidence, least: RigEvidence) -> bool:
    """Tell whether no amount is larger than any cause makes, or too small to be needed."""
    smallest, most = np.array(
        [(CAUSES[cause].amount.least, CAUSES[cause].amount.most) for cause in fit.causes]
    ).T
    cov = fit.cov_of_amounts(slopes_of(points, fit, fit.causes, fit.amounts))
    cov = cov * fit.times_chance(least)
    needed = np.abs(fit.amounts) > np.sqrt(PENALTY * np.diag(cov))
    size = np.abs(fit.amounts)
    return bool(((size >= smallest) & (size < most) & needed).all())


def _motion_left(points: DivePoints, at: RigEvidence) -> Motion:
    if not points.couples:
        return NO_MOTION
    couples = [seen_twice(points, at.reading, couple) for couple in points.couples]
    return motion_of(couples, points.geometry)


def _explanation(fit: RigEvidence, points: DivePoints, least: RigEvidence) -> Explanation:
    """least: the errors of the evidence are those that it leaves."""
    misfit = fit.misfit(least)
    if not fit.causes:
        return Explanation("", (), misfit)
    chosen = [CAUSES[cause] for cause in fit.causes]
    cov = fit.cov_of_amounts(slopes_of(points, fit, fit.causes, fit.amounts))
    cov = cov * fit.times_chance(least)
    texts = [
        cause.named(float(amount), float(std))
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
    std = float(
        np.linalg.norm([*parts, 1.25 * deviation_about_zero(off - error) / np.sqrt(len(off))])
    )
    uneven = most_of(np.abs(off - error))
    uneven_std = most_of(np.sqrt(((beside @ cov) * beside).sum(axis=1)))
    return Explanation(
        " and ".join(texts),
        tuple(chosen),
        misfit,
        error,
        std,
        most_of(np.abs(off)),
        abs(error) > max(RANGE_ERROR, DEVIATIONS * of_causes)
        or uneven > max(RANGE_ERROR, DEVIATIONS * uneven_std)
        or any(
            cause in STRETCHED and abs(amount) > RANGE_ERROR
            for cause, amount in zip(chosen, fit.amounts, strict=True)
        ),
    )


def _range_errors(points: DivePoints, fit: RigEvidence) -> tuple[Array, Array]:
    """(m,) the relative error of each point's range as calibrated, if the causes explain it; and
    (m, causes) by how much it grows with each amount.
    """
    step = -(-len(points.left) // MEASURED)
    raw = points.left[::step], points.right[::step]

    def ranges(reading: Reading) -> Array:
        left, right = (one / points.geometry.focal_px for one in points.read(reading, *raw))
        return np.asarray(np.linalg.norm(reading.points(left, (left - right)[:, 0]), axis=1))

    as_given, true = ranges(Reading(points.rig)), ranges(fit.reading)
    off = as_given / true - 1
    grows = []
    for number, cause in enumerate(fit.causes):
        more = CAUSES[cause].amount.step
        amounts = fit.amounts + more * np.eye(len(fit.causes))[number]
        other = as_given / ranges(reading_of(points.rig, fit.causes, amounts)) - 1
        grows.append((other - off) / more)
    by_amounts = np.column_stack(grows)
    known = np.isfinite(off) & np.isfinite(by_amounts).all(axis=1)
    return off[known], by_amounts[known]
