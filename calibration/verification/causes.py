"""What explains the rows and the motion of a dive: the causes of the table, each tested against all
others on the same evidence.

The evidence is linear: how rows of matched points disagree over the image and with range, and by
what disparities and the focal length must change for points to move rigidly between pairs
(``motion``). Each cause predicts all of it by one amount: points of the dive are seen by the rig as
the cause makes it, and read as the calibration says. Of causes that explain as much, all are named.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from calibration.rectification import (
    plan_rectification,
    raw_points,
    rectified_points,
)
from calibration.resampling import jackknife
from calibration.rig import StereoRig
from calibration.verification.matches import Matches
from calibration.verification.motion import LIMITS as MOTION_LIMITS
from calibration.verification.motion import fit_clear, range_error
from calibration.verification.rigid_motion import COLUMNS, FOCAL, OFFSET, ROWS, SeenTwice
from calibration.verification.row_fits import robust_fit, row_inliers
from calibration.verification.table import CAUSES, MOVED, Cause

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
LEAST_POINTS = 20
"""Of a pair."""
MOST_LEFT_OUT = 10
"""Pairs that are left out, one by one, for standard errors."""
SHOWN = 400
"""Points whose change by each cause is computed: more tell the same."""


ROUNDS = 3
"""Of fits of the best explanations with what amounts of their size predict."""


@dataclass(frozen=True)
class Explanation:
    """Causes that explain the evidence together. text: with their amounts.

    misfit: squared standard errors that they leave. range_error, range_std:
    of ranges, median over the image, relative, with the offset that a usual lens model leaves and
    what the motion contradicts. is_wrong: ranges are off by more than 2 % and two standard errors.
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
        if not self.is_wrong:
            return "ranges are right to 2 %, or two standard errors"
        return (
            f"ranges may be off by {100 * self.range_error:+.0f} +- {100 * self.range_std:.0f} %, "
            f"by up to {100 * self.edge_error:.0f} % over the image"
        )


@dataclass(frozen=True)
class Causes:
    """best: what explains the evidence by the fewest causes; rivals: others as few that explain it
    as well. numbers: of the evidence, 0 where it was not tested.
    """

    best: Explanation | None = None
    rivals: tuple[Explanation, ...] = ()
    numbers: int = 0

    @property
    def explains(self) -> bool:
        """Tell whether the best leaves no more than chance does."""
        return self.best is not None and self.best.misfit <= ENOUGH * self.numbers

    @property
    def is_simple(self) -> bool:
        """Tell whether one cause explains all."""
        return self.explains and self.best is not None and len(self.best.causes) == 1

    @property
    def is_wrong(self) -> bool:
        """Tell whether ranges are wrong by the best explanation, or by one as good."""
        return bool(self._wrong)

    @property
    def _wrong(self) -> list[Explanation]:
        return [one for one in (self.best, *self.rivals) if one and one.is_wrong]

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
    def line(self) -> str:
        """The best and the rivals that say otherwise of ranges, what they do to these, and what to
        do; "" where nothing is to be explained.
        """
        if self.best is None or not self.best.text:
            return ""
        # of rivals that leave ranges right one is enough, and none where the best does as well
        harmless = [one for one in (self.best, *self.rivals) if not one.is_wrong][:1]
        named = [one for one in self.rivals if one.is_wrong or one in harmless]
        rivals = "".join(f"; as likely: {one.text}: {one.ranges}" for one in named)
        doubt = (
            ""
            if self.explains
            else "; no cause that was tested explains all, and the error of ranges may be another"
        )
        cures = dict.fromkeys(cause.cure for one in (self.best, *named) for cause in one.causes)
        return f"{self.best.text}: {self.best.ranges}{rivals}{doubt}: {'; '.join(cures)}"


NOT_TESTED = Causes()


def find_causes(
    rig: StereoRig, matches: Sequence[Matches], couples: Sequence[SeenTwice] = ()
) -> Causes:
    """Fit all causes to the rows of matches in the rig's rectified images, and to what couples of
    neighboring pairs show.

    Not tested where they show too few points.
    """
    try:
        evidence = _Observed.of(rig, matches, couples)
    except np.linalg.LinAlgError:  # all points in one place
        return NOT_TESTED
    if evidence is None:
        return NOT_TESTED
    seen = [(cause, *_predicted(cause, cause.amount.step, rig, evidence)) for cause in CAUSES]
    seen = [one for one in seen if np.isfinite(one[1]).all()]
    size = len(evidence.white)
    best = [_FittedCauses((), evidence.white, np.zeros(0), np.zeros((0, 0)))]
    for together in range(1, MOST_TOGETHER + 1):
        if best[0].misfit < PENALTY:
            break
        fits = [
            _fit(causes, evidence.whiten @ np.column_stack([seen[i][1] for i in causes]), evidence)
            for causes in combinations(range(len(seen)), together)
        ]
        fits = [fit for fit in fits if _is_plausible(fit, seen)]
        fits.sort(key=lambda fit: fit.misfit)
        if not fits or fits[0].misfit > best[0].misfit - PENALTY:
            break
        best = [fit for fit in fits if fit.misfit < fits[0].misfit + ALIKE]
    pair = evidence.geometry
    lens_error = (
        MOTION_LIMITS.lens_rad
        * pair.focal_px
        / float(np.median((evidence.left - evidence.right)[:, 0]))
    )
    explained = [
        _explanation(*_again(fit, seen, rig, evidence), lens_error, evidence.measured)
        for fit in best
    ]
    return Causes(explained[0], tuple(explained[1:]), size)


@dataclass(frozen=True, eq=False)
class _Observed:
    """white: (n,) the evidence in its standard errors; whiten: (n, n) makes it so. left, right:
    (m, 2) pixels of points in the rectified images, from ``geometry``'s principal points, that
    agree about the rows. measured: the error of ranges at the median disparity as the motion shows
    it, whatever the cause; NaN without motion.
    """

    white: Array
    whiten: Array
    left: Array
    right: Array
    geometry: RectifiedPair
    measured: float

    @classmethod
    def of(
        cls, rig: StereoRig, matches: Sequence[Matches], couples: Sequence[SeenTwice]
    ) -> "_Observed | None":
        plan = plan_rectification(rig)
        pair = plan.matching_pair
        centers = np.array([[pair.cx_left_px, pair.cy_px], [pair.cx_right_px, pair.cy_px]])
        sides = []
        for one in (one for one in matches if len(one.left) >= LEAST_POINTS):
            kept = row_inliers(one.left, one.right, pair)
            sides.append((one.left[kept] - centers[0], one.right[kept] - centers[1]))
        if not sides:
            return None
        numbers = np.repeat(np.arange(len(sides)), [len(left) for left, _ in sides])
        left, right = (np.concatenate([one[side] for one in sides]) for side in (0, 1))
        disparity = left[:, 0] - right[:, 0]
        in_front = disparity > 1
        if in_front.sum() < LEAST_POINTS:
            return None
        left, right, disparity, numbers = (
            values[in_front] for values in (left, right, disparity, numbers)
        )
        rows, row_cov = _row_evidence(right, disparity, right[:, 1] - left[:, 1], numbers, pair)
        values, cov = [rows], [row_cov]
        if len(couples) >= 3:
            moved, moved_cov = _motion_evidence(couples, pair)
            values, cov = [*values, moved], [*cov, moved_cov]
        whole = np.zeros((sum(map(len, values)),) * 2)
        whole[: len(row_cov), : len(row_cov)] = row_cov
        if len(cov) > 1:
            whole[len(row_cov) :, len(row_cov) :] = cov[1]
        whiten = np.linalg.inv(np.linalg.cholesky(whole))
        step = -(-len(left) // SHOWN)
        shown = left[::step]
        level = np.column_stack([right[::step, 0], shown[:, 1]])
        measured = float("nan")
        if len(values) > 1:
            offset_px, log_focal = values[1][:2]
            measured = float(range_error(offset_px, log_focal, float(np.median(disparity))))
        return cls(whiten @ np.concatenate(values), whiten, shown, level, pair, measured)

    def points(self, rig: StereoRig, taken: StereoRig) -> Array:
        """(m, 3) from the left camera, where rig ``taken`` took what ``rig`` rectified."""
        pair = self.geometry
        raw = raw_points(
            rig,
            np.add(self.left, [pair.cx_left_px, pair.cy_px]),
            np.add(self.right, [pair.cx_right_px, pair.cy_px]),
        )
        plan = plan_rectification(taken)
        pair = plan.matching_pair
        left, right = rectified_points(taken, *raw)
        disparity = left[:, 0] - right[:, 0] - (pair.cx_left_px - pair.cx_right_px)
        slopes = (left - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
        depth_m = pair.focal_px * pair.baseline_m / np.where(disparity > 1, disparity, np.nan)
        rays = np.column_stack([slopes, np.ones(len(slopes))])
        return np.asarray((rays * depth_m[:, None]) @ plan.R_left_matching)


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


def _motion_evidence(couples: Sequence[SeenTwice], pair: RectifiedPair) -> tuple[Array, Array]:
    """(4,) offset, focal length, and disparities over rows and columns, and their covariance, with
    that of a usual lens model.
    """
    chosen = [OFFSET, FOCAL, ROWS, COLUMNS]
    fitted, free = fit_clear(couples, pair)
    off = (fitted.partial - fitted.partial.mean(axis=0))[:, chosen]
    lens_px = MOTION_LIMITS.lens_rad * pair.focal_px
    lens = np.array([lens_px, MOTION_LIMITS.focal, lens_px / 2, lens_px / 2])
    between = (len(couples) - 1) / len(couples) * off.T @ off
    cov = between + np.diag(fitted.formal[chosen] ** 2 + lens**2)
    cov[1, 1] += FOCAL not in free
    return fitted.values[chosen], np.asarray(cov, np.float64)


def _predicted(
    cause: Cause, amount: float, rig: StereoRig, evidence: _Observed
) -> tuple[Array, Array]:
    """(n,) the evidence of a cause of this amount, and (m,) the relative error of each point's
    range, both for an amount of 1.
    """
    pair = evidence.geometry
    taken = rig if cause.make is None else cause.make(rig, amount)
    points = evidence.points(rig, taken)
    left, right = _seen(rig, rig, points)
    if cause.make is None:
        left_now, right_now = left, right.copy()
        right_now[:, 0] -= amount * right[:, 1] / (pair.image_size[1] / 2)
    else:
        left_now, right_now = _seen(taken, rig, points)
    use = np.isfinite([left_now, right_now, left, right]).all(axis=(0, 2))
    before, after = left[:, 0] - right[:, 0], left_now[:, 0] - right_now[:, 0]
    ranges: Array = (before / after - 1) / amount
    if use.sum() < LEAST_POINTS:
        return np.full(len(evidence.white), np.nan), ranges
    left, right, left_now, right_now, before, after = (
        values[use] for values in (left, right, left_now, right_now, before, after)
    )
    rows = (right_now - left_now)[:, 1] - (right - left)[:, 1]
    predicted = np.linalg.lstsq(_terms(right, before, pair), rows, rcond=None)[0]
    if len(evidence.white) > len(predicted):
        predicted = np.append(predicted, _predicted_motion(left, left_now, before, after, pair))
    return np.asarray(predicted / amount, np.float64), ranges


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


def _seen(taken: StereoRig, read: StereoRig, of: Array) -> tuple[Array, Array]:
    """(m, 2) pixels, from the principal points, of points (m, 3) as the one rig takes them and the
    other reads them.
    """
    plan = plan_rectification(taken)
    pair, pixels = plan.matching_pair, []
    right = of @ taken.R.T + taken.T_right_left[:3, 3]
    for points, R, cx_px in (
        (of, plan.R_left_matching, pair.cx_left_px),
        (right, plan.R_right_matching, pair.cx_right_px),
    ):
        turned = points @ R.T
        pixels.append(pair.focal_px * turned[:, :2] / turned[:, 2:] + [cx_px, pair.cy_px])
    at_left, at_right = rectified_points(read, *raw_points(taken, pixels[0], pixels[1]))
    pair = plan_rectification(read).matching_pair
    return at_left - [pair.cx_left_px, pair.cy_px], at_right - [pair.cx_right_px, pair.cy_px]


@dataclass(frozen=True, eq=False)
class _FittedCauses:
    """causes: places in the table. rest: (n,) what they leave. amounts, cov: of the causes."""

    causes: tuple[int, ...]
    rest: Array
    amounts: Array
    cov: Array

    @property
    def misfit(self) -> float:
        return float(self.rest @ self.rest)


def _fit(causes: Iterable[int], predicted: Array, evidence: _Observed) -> _FittedCauses:
    amounts = np.linalg.lstsq(predicted, evidence.white, rcond=None)[0]
    cov = np.asarray(np.linalg.pinv(predicted.T @ predicted))
    rest = evidence.white - predicted @ amounts
    return _FittedCauses(tuple(causes), rest, np.asarray(amounts), cov)


_Seen = tuple[Cause, Array, Array]


def _is_plausible(fit: _FittedCauses, seen: Sequence[_Seen]) -> bool:
    """Tell whether no amount is larger than any cause makes, or too small to be needed."""
    most = np.array([seen[i][0].amount.most for i in fit.causes])
    needed = np.abs(fit.amounts) > np.sqrt(PENALTY * np.diag(fit.cov))
    return bool((np.abs(fit.amounts) < most).all() and needed.all())


def _again(
    fit: _FittedCauses, seen: Sequence[_Seen], rig: StereoRig, evidence: _Observed
) -> tuple[_FittedCauses, Sequence[_Seen]]:
    """Fit again with what amounts of this size predict: a large one is not in proportion."""
    seen = list(seen)
    for _ in range(ROUNDS):
        for place, amount in zip(fit.causes, fit.amounts, strict=True):
            cause = seen[place][0]
            now = (cause, *_predicted(cause, float(amount), rig, evidence))
            seen[place] = now if np.isfinite(now[1]).all() else seen[place]
        predicted = [seen[place][1] for place in fit.causes]
        if predicted:
            fit = _fit(fit.causes, evidence.whiten @ np.column_stack(predicted), evidence)
    return fit, seen


def _explanation(
    fit: _FittedCauses, seen: Sequence[_Seen], lens_error: float, measured: float
) -> Explanation:
    """lens_error: of ranges, relative, that a usual lens model leaves. measured: by the motion."""
    if not fit.causes:
        return Explanation("", (), fit.misfit)
    chosen = [seen[i] for i in fit.causes]
    texts = [
        cause.text.format(f"{cause.amount.unit * amount:+.2g}", f"{cause.amount.unit * std:.1g}")
        for (cause, *_), amount, std in zip(
            chosen, fit.amounts, np.sqrt(np.diag(fit.cov)), strict=True
        )
    ]
    errors = np.column_stack([error for *_, error in chosen])
    errors = errors[np.isfinite(errors).all(axis=1)]
    middle = np.median(errors, axis=0)
    # what is not understood makes all errors larger
    cov = fit.cov * max(1.0, fit.misfit / max(len(fit.rest) - len(chosen), 1))
    off, beside = errors @ fit.amounts, errors - middle
    error, std = float(np.median(off)), float(np.hypot(np.sqrt(middle @ cov @ middle), lens_error))
    uneven = _most(np.abs(beside @ fit.amounts))
    uneven_std = _most(np.sqrt(((beside @ cov) * beside).sum(axis=1)))
    return Explanation(
        " and ".join(texts),
        tuple(cause for cause, *_ in chosen),
        fit.misfit,
        error,
        std if np.isnan(measured) else float(np.hypot(std, measured - error)),
        _most(np.abs(off)),
        abs(error) > max(RANGE_ERROR, DEVIATIONS * std)
        or uneven > max(RANGE_ERROR, DEVIATIONS * uneven_std),
    )


def _most(values: Array) -> float:
    return float(np.quantile(values, 0.95))
